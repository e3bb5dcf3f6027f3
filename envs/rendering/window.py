"""A window on the desktop that shows finished pictures at a steady pace."""

from __future__ import annotations

import pygame


class Window:
    """Pygame's only window; once closed by its user, it shows nothing more.

    Args:
        size: width and height, pixels.
        fps: pictures a second.
    """

    def __init__(self, size: tuple[int, int], fps: int) -> None:
        pygame.display.init()
        self._screen: pygame.Surface | None = pygame.display.set_mode(size)
        self._clock = pygame.time.Clock()
        self._fps = fps

    def show(self, picture: pygame.Surface, title: str) -> None:
        """Show a picture, handle events, and wait until the next one is due."""
        if self._screen is None:
            return
        if any(event.type == pygame.QUIT for event in pygame.event.get()):
            self.close()
            return
        if pygame.display.get_caption()[0] != title:
            pygame.display.set_caption(title)
        self._screen.blit(picture, (0, 0))
        pygame.display.flip()
        self._clock.tick(self._fps)

    def close(self) -> None:
        """Close the window."""
        if self._screen is not None:
            pygame.display.quit()
            self._screen = None
