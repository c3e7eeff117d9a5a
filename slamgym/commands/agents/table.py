"""``slamgym agents <command>``: train, evaluate and compare explorers."""

from slamgym.commands.table import Command, CommandTable

COMMANDS: dict[str, Command] = {
    "train": Command("slamgym.commands.agents.train:main", "train a policy by reinforcement learning"),
    "evaluate": Command(
        "slamgym.commands.agents.evaluate:main", "compare explorers on the same plans and seeds"
    ),
    "shape": Command("slamgym.commands.agents.shape:main", "compare reward presets over several seeds"),
}

TABLE = CommandTable("slamgym agents", COMMANDS)


def main(argv: list[str]) -> int:
    """Run one of the commands; returns the exit code.

    Raises:
        SlamgymError: If there is no such command.
    """
    return TABLE.run(argv)
