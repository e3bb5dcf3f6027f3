"""The camera of one environment: its frames, with the trail of the hand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from envs.rendering import Renderer
from envs.task import Task

Frame = NDArray[np.uint8]


class TaskCamera:
    """Draws one environment, with the trail of its hand."""

    def __init__(self, task: Task, env_index: int, *, window: bool = False) -> None:
        self._task, self._env, self._window = task, env_index, window
        self._trail: list[tuple[float, ...]] = []
        self._renderer: Renderer | None = None

    @property
    def trail(self) -> tuple[tuple[float, ...], ...]:
        """Past positions of the hand, m."""
        return tuple(self._trail)

    @trail.setter
    def trail(self, positions: Sequence[tuple[float, ...]]) -> None:
        self._trail = list(positions)

    def begin(self) -> None:
        """Begin a new trail."""
        self._trail.clear()

    def follow(self) -> None:
        """Add the current hand position to the trail."""
        self._trail.append(tuple(self._task.hand_position(self._env).tolist()))

    def frame(self) -> Frame:
        """Draw the environment as it is now."""
        if self._renderer is None:
            self._renderer = Renderer(self._task.view, window=self._window, fps=self._task.frame_rate)
        return self._renderer.draw(self._task.scene(self._env, self._trail))

    def close(self) -> None:
        """Close the window."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None
