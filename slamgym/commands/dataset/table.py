"""``slamgym dataset <command>``: what can be done with explorations that exist."""

from slamgym.commands.table import Command, CommandTable

COMMANDS: dict[str, Command] = {
    "merge": Command("slamgym.commands.dataset.merge:main", "put the shards of a dataset together"),
    "stats": Command("slamgym.commands.dataset.stats:main", "what lies in a dataset, as tables or JSON"),
    "show": Command("slamgym.commands.dataset.show:main", "draw pairs: a sample, some by name, the worst"),
    "check": Command("slamgym.commands.dataset.check:main", "verify every file and name every fault"),
    "clean": Command("slamgym.commands.dataset.clean:main", "decide which pairs are complete enough to keep"),
    "review": Command(
        "slamgym.commands.dataset.review:main", "a page on which a person judges doubtful pairs"
    ),
    "split": Command(
        "slamgym.commands.dataset.split:main", "put plans, with their near-duplicates, on a side"
    ),
    "render": Command("slamgym.commands.dataset.render:main", "make uniform square images for training"),
}

TABLE = CommandTable("slamgym dataset", COMMANDS, closing=". `slamgym generate` makes a dataset.")


def main(argv: list[str]) -> int:
    """Run one of the commands; returns the exit code.

    Raises:
        SlamgymError: If there is no such command.
    """
    return TABLE.run(argv)
