"""Films: pictures written as an MP4 or a GIF."""

import importlib.util
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import imageio.v2 as imageio
import numpy as np

from slamgym.core.errors import ConfigError
from slamgym.core.files import staged
from slamgym.core.types import ByteArray

FILM_SUFFIXES = (".mp4", ".gif")

ShowPicture = Callable[[ByteArray], None]


def check_film_name(path: Path) -> None:
    """Refuse a name that no film can have, or that this installation can't write.

    Raises:
        ConfigError: If it ends neither in .mp4 nor in .gif, or in .mp4 and ffmpeg isn't installed.
    """
    if path.suffix.lower() not in FILM_SUFFIXES:
        raise ConfigError(f"{path}: a film's name must end in {' or '.join(FILM_SUFFIXES)}")
    if path.suffix.lower() == ".mp4" and importlib.util.find_spec("imageio_ffmpeg") is None:
        raise ConfigError(
            f"{path}: an MP4 needs ffmpeg; install it with: pip install 'slamgym[films]', or write a .gif"
        )


@contextmanager
def open_film(path: Path, frames_per_second: float) -> Iterator[ShowPicture]:
    """Give a function that appends an RGB picture; the film appears when the block ends well.

    Raises:
        ConfigError: If the film's name ends neither in .mp4 nor in .gif, or ffmpeg is missing.
        InputFileError: If it can't be written.
    """
    check_film_name(path)
    with staged(path) as part:
        if path.suffix.lower() == ".gif":
            writer: Any = imageio.get_writer(
                part, format="GIF", duration=1000.0 / frames_per_second, loop=0
            )
        else:
            # The default block size of 16 would scale the picture.
            writer = imageio.get_writer(
                part, format="FFMPEG", fps=frames_per_second, macro_block_size=2
            )
        with writer:
            yield lambda picture: writer.append_data(_even(picture))


def _even(picture: ByteArray) -> ByteArray:
    """H.264 wants even numbers of rows and columns."""
    rows, cols = picture.shape[:2]
    below = (0, rows % 2)
    beside = (0, cols % 2)
    return np.pad(picture, (below, beside, (0, 0)), mode="edge")
