"""``slamgym gan <command>``: train, translate, evaluate."""

from slamgym.commands.table import Command, CommandTable
from slamgym.core.errors import SlamgymError

COMMANDS: dict[str, Command] = {
    "train": Command(
        "slamgym.commands.gan.train:main", "train a translator on a folder of rendered map pairs"
    ),
    "translate": Command(
        "slamgym.commands.gan.translate:main", "translate an image, a ROS map or a folder of images"
    ),
    "evaluate": Command(
        "slamgym.commands.gan.evaluate:main", "measure a translator on held-out pairs, beside the baselines"
    ),
}

TABLE = CommandTable(
    "slamgym gan", COMMANDS, about="Translate SLAM maps to CAD drawings, and CAD drawings to SLAM maps."
)

_EXTRA = {"torch", "safetensors", "sklearn", "tensorboard"}


def main(argv: list[str]) -> int:
    """Run one command of the translators; returns the exit code.

    Raises:
        SlamgymError: If the command is unknown, or a package of the extra ``gan`` isn't installed.
    """
    try:
        return TABLE.run(argv)
    except ModuleNotFoundError as error:
        if error.name not in _EXTRA:
            raise
        raise SlamgymError(
            f"the package {error.name!r} is missing; install the extra: pip install 'slamgym[gan]'"
        ) from error
