"""Watching a map grow: in a window, or written as a film."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import imageio.v2 as imageio
import numpy as np

from slamgym.core.errors import ConfigError, SlamgymError
from slamgym.core.files import staged
from slamgym.core.types import ByteArray, FloatArray, GridFrame
from slamgym.slam.mapper import Mapper
from slamgym.viz.map_pictures import view_picture

VIEW_SIZE = (1024, 768)  # width, height [px]; multiples of 16, as video encoders want them
FILM_SUFFIXES = (".mp4", ".gif")
MAX_FRAMES = 600
FRAMES_PER_SECOND = 20
MAX_PATHS = 30

ShowFrame = Callable[[ByteArray], None]


class GrowingView:
    """Draws a mapper's state on a canvas whose scale only ever shrinks."""

    def __init__(self) -> None:
        self._bounds: tuple[float, float, float, float] | None = None

    def draw(self, mapper: Mapper, caption: str) -> ByteArray:
        """The map so far with the best path and those of the other particles."""
        grid = mapper.occupancy_grid()
        paths: list[FloatArray] = [mapper.trajectory().poses]
        others: Callable[[int], list[FloatArray]] | None = getattr(mapper, "particle_paths", None)
        if others is not None:
            paths += others(MAX_PATHS)
        frame = self._frame(grid.frame)
        return view_picture(grid, frame, VIEW_SIZE, paths, caption)

    def _frame(self, grid: GridFrame) -> GridFrame:
        """A frame that holds the grid; grown by a quarter at a time, so that the picture seldom jumps."""
        min_x, min_y, max_x, max_y = grid.bounds
        old = self._bounds
        if old is None or min_x < old[0] or min_y < old[1] or max_x > old[2] or max_y > old[3]:
            spare = 0.125 * max(max_x - min_x, max_y - min_y, 4.0)
            new = (min_x - spare, min_y - spare, max_x + spare, max_y + spare)
            if old is not None:
                new = (min(new[0], old[0]), min(new[1], old[1]), max(new[2], old[2]), max(new[3], old[3]))
            self._bounds = new
        assert self._bounds is not None
        return GridFrame.covering(self._bounds, grid.resolution)


def film_writer(path: Path) -> AbstractContextManager[ShowFrame]:
    """A context manager that gives a function to append frames; the film appears when it ends well.

    Raises:
        ConfigError: If the file's name ends neither in .mp4 nor in .gif.
    """
    if path.suffix.lower() not in FILM_SUFFIXES:
        raise ConfigError(f"{path}: a film's name must end in {' or '.join(FILM_SUFFIXES)}")
    return _film_writer(path)


@contextmanager
def _film_writer(path: Path) -> Iterator[ShowFrame]:
    with staged(path) as part:
        if path.suffix.lower() == ".gif":
            writer: Any = imageio.get_writer(part, mode="I", duration=1000.0 / FRAMES_PER_SECOND, loop=0)
        else:
            writer = imageio.get_writer(part, fps=FRAMES_PER_SECOND, macro_block_size=16, quality=7)
        with writer:
            yield writer.append_data


@contextmanager
def window(title: str) -> Iterator[ShowFrame]:
    """A window; gives a function to show a frame.

    Raises:
        ConfigError: If pygame isn't installed or there is no screen.
    """
    try:
        import pygame
    except ImportError as error:
        raise ConfigError("--watch needs pygame; install it with: pip install 'slamgym[human]'") from error
    try:
        pygame.display.init()
        screen = pygame.display.set_mode(VIEW_SIZE)
    except pygame.error as error:
        raise ConfigError(
            f"--watch can't open a window ({error}); write a film with --video instead"
        ) from error
    pygame.display.set_caption(title)

    def show(frame: ByteArray) -> None:
        for event in pygame.event.get():
            if event.type == pygame.QUIT:
                raise SlamgymError("the window was closed; nothing was written")
        screen.blit(pygame.surfarray.make_surface(np.swapaxes(frame, 0, 1)), (0, 0))
        pygame.display.flip()

    try:
        yield show
    finally:
        pygame.display.quit()
