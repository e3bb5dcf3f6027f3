"""What every expert is: observations in, actions out, behind the `predict` of a Stable-Baselines3 policy."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from envs.actuation import action_scale
from envs.observation import Observation
from envs.task import Task
from planners.control import held_torque
from planners.typing import Array

Actions = NDArray[np.float32]


class Expert(ABC):
    """A policy that is not learnt.

    Attributes:
        plans_made: number of motions planned so far.
        planning_seconds: time they took.
        infeasible: how many of them had no solution.
    """

    def __init__(self, task: Task) -> None:
        self.task = task
        self.plans_made = 0
        self.planning_seconds = 0.0
        self.infeasible = 0
        self._memory: Any = None
        if task.action_space().shape != (task.arm.n_joints,):
            raise ValueError(
                f"experts act at every instant, and control_mode {task.config.control_mode!r} of {task.env_id} takes "
                "another kind of action; leave it out"
            )
        self._scale = action_scale(task.arm, task.actuation_mode(task.config))

    def predict(
        self,
        observation: Observation,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = False,
    ) -> tuple[Actions, Any]:
        """Actions for observations.

        Args:
            observation: ``(size,)`` or ``(lanes, size)``.
            state: what the last call returned; None to go on from this expert's own last call.
            episode_start: ``(lanes,)``, which lanes are at the first step of an episode; may be left out, because the
                observation tells the time.
            deterministic: accepted for compatibility; experts are deterministic unless their name says otherwise.

        Returns:
            Actions in [-1, 1], ``(n,)`` or ``(lanes, n)``, and the state for the next call.

        Raises:
            ValueError: if the observation has the wrong size.
        """
        batch = np.atleast_2d(observation)
        starts = np.zeros(len(batch), dtype=bool)
        if episode_start is not None:
            starts |= np.asarray(episode_start, dtype=bool)
        actions, self._memory = self._act(batch, self._memory if state is None else state, starts)
        clipped: Actions = np.clip(actions, -1.0, 1.0).astype(np.float32)
        return (clipped[0] if np.ndim(observation) == 1 else clipped), self._memory

    @abstractmethod
    def _act(self, observations: Observation, state: Any, starts: NDArray[np.bool_]) -> tuple[Array, Any]:
        """Unclipped actions ``(lanes, n)`` and the next state."""

    def _begins(self, seen: dict[str, Array]) -> NDArray[np.bool_]:
        """Lanes at the first step of an episode, ``(lanes,)``, by the time that is left."""
        config = self.task.config
        begins: NDArray[np.bool_] = seen["time_left"][:, 0] > config.horizon - 0.5 * config.control_period
        return begins

    def _action_for(self, seen: dict[str, Array], qdd: Array) -> Array:
        """The action, in the environment's control mode, that gives mean joint accelerations ``(lanes, n)``."""
        config = self.task.config
        if config.control_mode == "acceleration":
            wanted = qdd
        elif config.control_mode == "jerk":
            wanted = (qdd - seen["joint_acceleration"]) / config.control_period
        elif config.control_mode == "velocity":
            wanted = seen["joint_velocity"] + config.control_period * qdd
        else:
            q, qd = seen["joint_position"], seen["joint_velocity"]
            wanted = held_torque(self.task.arm, q, qd, qdd, config.control_period)
        return wanted / self._scale
