"""A window for ``render_mode="human"``."""

from typing import Any

from slamgym.core.errors import SlamgymError
from slamgym.core.types import ByteArray


class Window:
    """Shows pictures at a steady rate.

    Args:
        frames_per_second: Rate at which :meth:`show` returns.

    Raises:
        SlamgymError: If pygame isn't installed, or there is no display.
    """

    def __init__(self, frames_per_second: float) -> None:
        try:
            import pygame
        except ImportError:
            raise SlamgymError(
                'render_mode="human" needs pygame; install it with: pip install "slamgym[human]"'
            ) from None
        self._pygame: Any = pygame
        self._rate = frames_per_second
        self._screen: Any = None
        pygame.display.init()
        self._clock = pygame.time.Clock()

    def show(self, image: ByteArray) -> None:
        """Show an RGB image, shape (height, width, 3), and wait for the time of the next one."""
        pygame = self._pygame
        if self._screen is None:
            try:
                self._screen = pygame.display.set_mode((image.shape[1], image.shape[0]))
            except pygame.error as error:
                raise SlamgymError(
                    f'render_mode="human" can\'t open a window ({error}); '
                    'use render_mode="rgb_array" without a display'
                ) from None
            pygame.display.set_caption("slamgym")
        pygame.event.pump()
        self._screen.blit(pygame.surfarray.make_surface(image.swapaxes(0, 1)), (0, 0))
        pygame.display.flip()
        self._clock.tick(self._rate)

    def close(self) -> None:
        """Close the window."""
        self._pygame.display.quit()
