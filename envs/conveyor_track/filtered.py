"""A policy that acts by jerks on filtered joints and a filtered part, where the settings declare noise.

The filters are linear: joints and part move freely, the joints with the accelerations that the jerks command, the part
with that of the belt. So a policy that was trained without noise observes nearly what it would without it.

Source of the filters: `planners.control.point_filter`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeGuard

import numpy as np
from numba import njit
from numpy.typing import NDArray

from envs.conveyor_track.env import ConveyorTrack
from envs.experts.base import Expert
from envs.observation import Observation
from planners.control.joint_limits import smooth_bounds
from planners.control.point_filter import WIDTH, PointFilter
from planners.typing import Array

UNMODELLED = 0.02
"""Standard deviation of the joint acceleration that the filter does not know, rad/s^2."""

_SURE = 1e-7  # rad; noise of encoders that have none


class Track(NamedTuple):
    """What is remembered of an episode."""

    joints: Array  # of the filter of the joints, taken for the two coordinates of one point: (num_envs, 1, WIDTH)
    part: Array  # of the filter of the part, (num_envs, 1, WIDTH)
    commanded: Array  # accelerations that the jerks so far command, (num_envs, 2), rad/s^2


class FilteredPolicy(Expert):
    """A network between the filters and the jerks.

    Args:
        task: the environment's task, with ``control_mode="jerk"``; see `wanted`.
        network: gives actions ``(num_envs, 2)`` for observations ``(num_envs, size)``.
    """

    def __init__(self, task: ConveyorTrack, network: Callable[[Observation], NDArray[np.float32]]) -> None:
        super().__init__(task)
        self._network = network
        noise = {name: max(values) for name, values in task.uncertainty.ends.items()}
        encoder, velocity, camera = (noise[f"{name}_noise"] for name in ("encoder", "velocity", "camera"))
        self._period = period = task.config.control_period
        self._joints = PointFilter(period, (max(encoder, _SURE), velocity), UNMODELLED) if encoder or velocity else None
        self._part = PointFilter(period, (camera, camera / period)) if camera else None
        self._limits = np.array([task.arm.limits.array(kind) for kind in ("velocity", "acceleration", "jerk")])

    @staticmethod
    def wanted(task: object) -> TypeGuard[ConveyorTrack]:
        """Whether a task is the belt with noise, acted on by jerks."""
        return isinstance(task, ConveyorTrack) and task.config.control_mode == "jerk" and task.uncertainty.noisy

    def _act(self, observations: Observation, state: Any, starts: NDArray[np.bool_]) -> tuple[Array, Track]:
        seen = self.task.layout.parse(observations)
        begins = starts | self._begins(seen)
        if not isinstance(state, Track) or len(state.commanded) != len(begins):
            begins = np.ones(len(begins), dtype=bool)
            empty = np.zeros((len(begins), 1, WIDTH))
            state = Track(empty, empty, np.zeros((len(begins), 2)))
        track = Track(*(memory.copy() for memory in state))
        track.commanded[begins] = 0.0
        self._filter_joints(seen, track, begins)
        if self._part is not None:
            place, rate, known = (seen[name][:, None] for name in ("part", "part_velocity", "part_acceleration"))
            self._part.update(track.part, begins, place, rate, known)
            seen["part"], seen["part_velocity"] = track.part[:, 0, :2], track.part[:, 0, 2:4]
        seen["part_error"] = seen["part"] - seen["hand"]
        actions = self._network(self.task.layout.compose(seen)).astype(float)
        _command(seen["joint_velocity"].copy(), actions, self._period, self._limits, track.commanded)
        return actions, track

    def _filter_joints(self, seen: dict[str, Array], track: Track, begins: NDArray[np.bool_]) -> None:
        """Replace joints and hand in what is seen by their estimates; an episode begins at rest."""
        if self._joints is None:
            return
        angles, speeds = seen["joint_position"][:, None], seen["joint_velocity"][:, None]
        self._joints.update(track.joints, begins, angles, speeds, track.commanded[:, None])
        track.joints[begins, 0, 2:4] = track.joints[begins, 0, 6] = 0.0  # velocities, and their variance
        seen["joint_position"], seen["joint_velocity"] = track.joints[:, 0, :2], track.joints[:, 0, 2:4]
        seen["joint_acceleration"] = track.commanded
        seen["hand"] = self.task.arm.forward_kinematics(seen["joint_position"].copy()) - self.task.arm.base_array


@njit(cache=True, nogil=True)
def _command(speeds: Array, shares: Array, period: float, limits: Array, commanded: Array) -> None:
    """Add jerks, shares of their limits, to the commanded accelerations of every row, within what keeps all limits.

    ``limits`` are of velocity, acceleration and jerk, ``(3, n)``. See `envs.physics.actuation`.
    """
    for row in range(commanded.shape[0]):
        for i in range(commanded.shape[1]):
            bounds = smooth_bounds(speeds[row, i], commanded[row, i], period, limits[0, i], limits[1, i], limits[2, i])
            share = min(1.0, max(-1.0, shares[row, i]))
            commanded[row, i] = min(bounds[1], max(bounds[0], commanded[row, i] + share * limits[2, i] * period))
