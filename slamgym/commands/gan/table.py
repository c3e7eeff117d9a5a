"""``slamgym gan <command>``: train, translate, evaluate, publish."""

from slamgym.commands.table import Command, CommandTable

COMMANDS: dict[str, Command] = {
    "train": Command(
        "slamgym.commands.gan.arguments:train_command", "train a translator on a folder of rendered map pairs"
    ),
    "translate": Command(
        "slamgym.commands.gan.arguments:translate_command",
        "translate an image, a ROS map or a folder of images",
    ),
    "evaluate": Command(
        "slamgym.commands.gan.arguments:evaluate_command",
        "measure a translator on held-out pairs, beside the baselines",
    ),
    "publish": Command(
        "slamgym.commands.gan.arguments:publish_command",
        "put the weights of a run among the pretrained ones",
    ),
}

TABLE = CommandTable(
    "slamgym gan", COMMANDS, about="Translate SLAM maps to CAD drawings, and CAD drawings to SLAM maps."
)


def main(argv: list[str]) -> int:
    """Run one command of the translators; returns the exit code.

    Raises:
        SlamgymError: If the command is unknown, or a package of the extra ``gan`` isn't installed.
    """
    return TABLE.run(argv)
