"""A window that shows pictures as they come."""

import os
from typing import Any

from slamgym.core.errors import SlamgymError
from slamgym.core.types import ByteArray


class WindowClosedError(SlamgymError):
    """A person closed the window."""


class Window:
    """Shows pictures, at a steady rate if one is given.

    Args:
        title: Of the window.
        frames_per_second: Rate at which :meth:`show` returns; 0 doesn't wait.

    Raises:
        SlamgymError: If pygame isn't installed, or there is no display.
    """

    def __init__(self, title: str, frames_per_second: float = 0.0) -> None:
        try:
            import pygame
        except ImportError:
            raise SlamgymError(
                'a window needs pygame; install it with: pip install "slamgym[human]"'
            ) from None
        self._pygame: Any = pygame
        self._title = title
        self._rate = frames_per_second
        self._screen: Any = None
        self._clock = pygame.time.Clock()
        self.held = set[str]()
        """Names of the keys that are held down, as of the last picture."""
        try:
            pygame.display.init()
        except pygame.error as error:
            raise _no_display(error) from None

    def show(self, picture: ByteArray) -> None:
        """Show an RGB picture, shape (height, width, 3), and wait for the time of the next one.

        Raises:
            SlamgymError: If there is no display; :class:`WindowClosedError` if the window was closed.
        """
        pygame = self._pygame
        if self._screen is None:
            try:
                self._screen = pygame.display.set_mode((picture.shape[1], picture.shape[0]))
            except pygame.error as error:
                raise _no_display(error) from None
            pygame.display.set_caption(self._title)
        for event in pygame.event.get():
            if event.type == pygame.QUIT:
                raise WindowClosedError("the window was closed before the end")
            if event.type == pygame.KEYDOWN:
                self.held.add(pygame.key.name(event.key))
            elif event.type == pygame.KEYUP:
                self.held.discard(pygame.key.name(event.key))
            elif event.type == pygame.WINDOWFOCUSLOST:  # the keys' ends go to another window
                self.held.clear()
        self._screen.blit(pygame.surfarray.make_surface(picture.swapaxes(0, 1)), (0, 0))
        pygame.display.flip()
        self._clock.tick(self._rate)

    @property
    def is_unseen(self) -> bool:
        """True if SDL found no screen, so that it draws where nobody sees it, and nobody asked it to."""
        return (
            "SDL_VIDEODRIVER" not in os.environ and self._pygame.display.get_driver() == "offscreen"
        )

    def close(self) -> None:
        """Close the window."""
        self._pygame.display.quit()


def _no_display(error: Exception) -> SlamgymError:
    return SlamgymError(
        f'can\'t open a window ({error}); without a display, write a film or use render_mode="rgb_array"'
    )
