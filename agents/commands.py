"""``slamgym agents <command>``: train, evaluate and compare explorers."""

from slamgym.command_table import Command, CommandTable

COMMANDS: dict[str, Command] = {
    "train": Command("agents.train_command:main", "train a policy by reinforcement learning"),
    "evaluate": Command("agents.evaluate_command:main", "compare explorers on the same plans and seeds"),
    "shape": Command("agents.shape_command:main", "compare reward presets over several seeds"),
}

TABLE = CommandTable("slamgym agents", COMMANDS)


def main(argv: list[str]) -> int:
    """Run one of the commands; returns the exit code.

    Raises:
        SlamgymError: If there is no such command.
    """
    return TABLE.run(argv)
