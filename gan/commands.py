"""``slamgym gan <command>``: train, translate, evaluate."""

import importlib
import sys
from collections.abc import Callable

from slamgym.config import suggest
from slamgym.errors import SlamgymError

COMMANDS: dict[str, tuple[str, str]] = {
    "train": ("gan.train_command:main", "train a translator on a folder of rendered map pairs"),
    "translate": ("gan.translate_command:main", "translate an image, a ROS map or a folder of images"),
    "evaluate": ("gan.evaluate_command:main", "measure a translator on held-out pairs, beside the baselines"),
}
"""Name to ``module:function`` and the line for the help."""


def main(argv: list[str]) -> int:
    """Run one command of the translators.

    Args:
        argv: The arguments after ``slamgym gan``.

    Returns:
        The exit code.

    Raises:
        SlamgymError: If the command is unknown or torch isn't installed.
    """
    if not argv or argv[0] in ("-h", "--help", "help"):
        sys.stdout.write(_usage())
        return 0
    name, rest = argv[0], argv[1:]
    if name not in COMMANDS:
        raise SlamgymError(
            f"unknown command 'gan {name}'; {suggest(name, COMMANDS)} (slamgym gan --help lists them all)"
        )
    run = _load(COMMANDS[name][0])
    return run(rest)


def _load(target: str) -> Callable[[list[str]], int]:
    module, function = target.split(":")
    try:
        loaded: Callable[[list[str]], int] = getattr(importlib.import_module(module), function)
    except ModuleNotFoundError as error:
        if error.name in {"torch", "safetensors", "sklearn", "tensorboard"}:
            raise SlamgymError(
                f"the package {error.name!r} is missing; install the extra: pip install 'slamgym[gan]'"
            ) from error
        raise
    return loaded


def _usage() -> str:
    width = max(map(len, COMMANDS))
    rows = "\n".join(f"  {name:<{width}}  {text}" for name, (_, text) in COMMANDS.items())
    return (
        "usage: slamgym gan <command> [options]\n\n"
        "Translate SLAM maps to CAD drawings, and CAD drawings to SLAM maps.\n\n"
        f"commands:\n{rows}\n\n"
        "slamgym gan <command> --help shows a command's options.\n"
    )
