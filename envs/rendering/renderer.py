"""`Renderer`: scenes to pictures, off screen or in a window."""

from __future__ import annotations

import numpy as np
from gymnasium.error import DependencyNotInstalled
from numpy.typing import ArrayLike, NDArray

from envs.rendering import manipulator, workcell
from envs.rendering.camera import Camera
from envs.rendering.panel import Panel
from envs.rendering.scene import Scene
from planners.typing import Array

PANEL_SHARE = 0.29
DESIGN_HEIGHT = 640.0


class Renderer:
    """Draws scenes; the same scene always gives the same pixels. Only a window needs a display.

    Args:
        view: visible part of the plane, ``(xmin, xmax, ymin, ymax)``, m.
        size: width and height of the picture, pixels.
        window: also show every picture in a window, at ``fps`` pictures a second.
        fps: pictures a second in the window.

    Raises:
        gymnasium.error.DependencyNotInstalled: if pygame-ce is not installed.
        ValueError: if the view is empty or the size too small.
    """

    def __init__(
        self,
        view: tuple[float, float, float, float],
        *,
        size: tuple[int, int] = (960, 640),
        window: bool = False,
        fps: int = 50,
    ) -> None:
        try:
            from envs.rendering import canvas
            from envs.rendering.window import Window
        except ImportError as error:
            raise DependencyNotInstalled('rendering needs pygame-ce; run: pip install "planarm[viz]"') from error
        if min(size) < 64:
            raise ValueError(f"picture size {size} must be at least 64 by 64 pixels")
        self._unit = size[1] / DESIGN_HEIGHT
        panel_width = PANEL_SHARE * size[0]
        self._camera = Camera(view, (size[0] - panel_width, size[1]))
        self._canvas = canvas.Canvas(size)
        self._pixels_of = canvas.pixels_of
        self._panel = Panel(self._canvas, panel_width, self._unit)
        self._window = Window(size, fps) if window else None

    def draw(self, scene: Scene) -> NDArray[np.uint8]:
        """The picture of a scene, ``(height, width, 3)``; also shown in the window, if there is one."""
        canvas, camera, unit = self._canvas, self._camera, self._unit
        joints = np.asarray(scene.joints, dtype=float)
        workcell.draw_floor(canvas, camera, joints, unit)
        if scene.ground is not None:
            workcell.draw_ground(canvas, camera, scene.ground, unit)
        if scene.belt is not None:
            workcell.draw_belt(canvas, camera, scene.belt)
        workcell.draw_obstacles(canvas, camera, scene.obstacles, unit)
        workcell.draw_second_arm(canvas, camera, scene.second_arm, unit)
        if scene.target is not None:
            workcell.draw_target(canvas, camera, scene.target, unit)
        if scene.trail is not None:
            workcell.draw_trail(canvas, camera, np.asarray(scene.trail, dtype=float), unit)
        if scene.part is not None:
            workcell.draw_part(canvas, camera, scene.part, unit, settled=scene.settled)
        manipulator.draw_arm(canvas, camera, joints, scene.torque_ratios, closed=scene.settled, bucket=scene.bucket)
        self._panel.draw_backdrop()
        self._panel.draw(scene)
        picture = canvas.finish()
        if self._window is not None:
            self._window.show(picture, scene.title)
        return self._pixels_of(picture)

    def pixels(self, points: ArrayLike) -> Array:
        """Pixel coordinates, to the right and down, of points ``(..., 2)``, m."""
        return self._camera.pixels(points)

    def close(self) -> None:
        """Close the window, if there is one; may be called again."""
        if self._window is not None:
            self._window.close()
            self._window = None
