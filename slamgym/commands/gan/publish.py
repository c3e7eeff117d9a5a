"""``slamgym gan publish``: make the weights of a run some that come with the package.

Copies the weights to ``gan/pretrained/NAME.safetensors`` with the model card and settings beside, and puts into
the card what the run can't know: what the pairs were made from, and the command as a user would type it.
"""

import dataclasses
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from slamgym.core.errors import ConfigError


@dataclass(frozen=True)
class PublishArguments:
    """Put the weights of a finished run among the pretrained ones."""

    run: Annotated[Path, tyro.conf.Positional]
    """Folder of the run, or its weights.safetensors."""
    name: Annotated[str, tyro.conf.Positional]
    """What load_translator shall find them by."""
    data: str = ""
    """What the pairs were made from."""
    command: str = ""
    """The command to repeat the training with, without paths of this machine."""
    out: Path | None = None
    """Folder of the pretrained weights; the package's by default."""


def main(argv: list[str]) -> int:
    """Run the command; returns the exit code."""
    arguments = tyro.cli(PublishArguments, args=argv, prog="slamgym gan publish")
    sys.stdout.write(f"{publish(arguments)}\n")
    return 0


def publish(arguments: PublishArguments) -> Path:
    """Write the files; returns the path of the weights.

    Raises:
        InputFileError: If the weights can't be read or written.
        ConfigError: If they are too large, or the name is no plain name.
    """
    from slamgym.gan.weights import MAX_BYTES, PRETRAINED, load_weights, save_translator

    if not arguments.name or Path(arguments.name).name != arguments.name:
        raise ConfigError(f"{arguments.name!r} is no plain name")
    weights = load_weights(arguments.run)
    card = dataclasses.replace(
        weights.card,
        data=arguments.data or weights.card.data,
        command=arguments.command or weights.card.command,
    )
    path = (arguments.out or PRETRAINED) / f"{arguments.name}.safetensors"
    save_translator(path, weights.generator, weights.config, card)
    if path.stat().st_size > MAX_BYTES:
        size = path.stat().st_size
        path.unlink()
        raise ConfigError(
            f"the weights have {size / 1e6:.1f} MB; at most {MAX_BYTES / 1e6:.0f} MB are published"
        )
    return path
