"""``slamgym dataset <command>``: what can be done with explorations that exist."""

from slamgym.command_table import Command, CommandTable

COMMANDS: dict[str, Command] = {
    "merge": Command("slamgym.dataset.merge_command:main", "put the shards of a dataset together"),
    "stats": Command("slamgym.dataset.stats_command:main", "what lies in a dataset, as tables or JSON"),
    "show": Command("slamgym.dataset.show_command:main", "draw pairs: a sample, some by name, the worst"),
    "check": Command("slamgym.dataset.check_command:main", "verify every file and name every fault"),
    "clean": Command("slamgym.dataset.clean_command:main", "decide which pairs are complete enough to keep"),
    "review": Command(
        "slamgym.dataset.review_command:main", "a page on which a person judges doubtful pairs"
    ),
    "split": Command(
        "slamgym.dataset.split_command:main", "put plans, with their near-duplicates, on a side"
    ),
    "render": Command("slamgym.dataset.render_command:main", "make uniform square images for training"),
}

TABLE = CommandTable("slamgym dataset", COMMANDS, closing=". `slamgym generate` makes a dataset.")


def main(argv: list[str]) -> int:
    """Run one of the commands; returns the exit code.

    Raises:
        SlamgymError: If there is no such command.
    """
    return TABLE.run(argv)
