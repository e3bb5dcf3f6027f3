"""Robust tracking of experts: what they observe under declared uncertainty, filtered and ahead of the latency."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from envs.experts.commands import NominalCommands
from envs.experts.continuity import Moment
from envs.observation import Observation
from envs.physics.actuation import CONTROL_MODES
from envs.task import Task
from envs.uncertainty.draw import DRAWN, ends
from planners import JointLimits
from planners.control import ArmObserver, Estimate, ObserverSettings
from planners.control.point_filter import WIDTH, PointFilter
from planners.robot.limits import LimitKind
from planners.typing import Array

_NEEDED = {"joint_position", "joint_velocity", "joint_acceleration", "time_left"}

_UNMODELLED = 0.02, 0.1
"""What the filter's model leaves out, and the same where arm or latency are unknown beside noise, or the environment
finds the torques of jerks, as a share of the acceleration that the first torque gives the stretched arm: less makes the
filter too certain, and masses and latency drift; more makes plans spend torque on noise."""

CAREFUL: dict[LimitKind, float] = {"torque": 0.8, "velocity": 0.97, "acceleration": 0.9, "jerk": 0.85}
"""Shares of the limits that a motion of experts takes under declared uncertainty; the rest is for corrections, and for
what an arm with other masses makes of a torque."""

_CALM = 0.8, 0.72
"""The share of the acceleration limit in jerk mode, where no acceleration takes back in a period what was too much: of
commands to an unknown arm, and of motions for one, which leave some of that for corrections."""


def careful(limits: JointLimits, acceleration: float = CAREFUL["acceleration"]) -> JointLimits:
    """The shares of some limits that are left for a motion, `CAREFUL` but for that of the acceleration."""
    shares: dict[LimitKind, float] = {**CAREFUL, "acceleration": acceleration}
    return replace(limits, **{kind: tuple((share * limits.array(kind)).tolist()) for kind, share in shares.items()})


_BY_VELOCITIES: dict[LimitKind, float] = {"torque": 0.97, "velocity": 0.996}
"""Shares of the limits that a motion takes whose commands are velocities: the environment cuts off what is more than
98 and 99.8 % of them, which makes jerk."""


def slower(limits: JointLimits) -> JointLimits:
    """The shares of some limits that are left for a motion by joint velocities."""
    return replace(limits, **{kind: tuple((s * limits.array(kind)).tolist()) for kind, s in _BY_VELOCITIES.items()})


_MANOEUVRE = {"part": 0.0, "obstacle": 0.2, "goal": 0.0}
"""What a camera sees, and the standard deviation of its unknown acceleration, in units of the scale of the observed
acceleration: the belt keeps to its acceleration, a disc turns with 2 m/s^2, the goal stands still."""


@dataclass(frozen=True)
class RobustState:
    """The `state` of an expert with robust tracking.

    Attributes:
        expert: the state of the expert itself.
        memory: of the observer, a row an environment.
        points: of the filter of each kind of points that a camera sees.
        moment: of the last observation.
        jerks: of the commands in jerk mode, ``(num_envs, 2, n)``; see `NominalCommands.follow`.
    """

    expert: Any
    memory: Array
    points: dict[str, Array]
    moment: Moment
    jerks: Array


class RobustTracking:
    """Kalman filters and a prediction over the latency between the observations and an expert.

    The expert observes joints, and what moves besides, as they are estimated for the time at which its action reaches
    the joints, and the time left from then on, less than a period short. Its accelerations become torques of the
    estimated arm, or the actions of `NominalCommands`. The settings say how uncertain each number is (a single number
    counts as a standard deviation around the nominal arm), the latency or its range, and the noise; what was drawn is
    estimated.

    Args:
        task: the environment's task, in a control mode of `CONTROL_MODES`.

    Attributes:
        unknown_arm: whether masses or friction are uncertain.
    """

    def __init__(self, task: Task) -> None:
        config, far = task.config, {name: max(task.uncertainty.ends[name]) for name in DRAWN}
        steps, (soonest, latest) = round(config.control_period / config.physics_step), ends(config.latency)
        self._task = task
        camera, scales = far["camera_noise"], {entry.name: entry.scale for entry in task.layout.entries}
        self._points = {
            name: PointFilter(
                config.control_period,
                (camera, camera / config.control_period if f"{name}_velocity" in scales else 0.0),
                share * scales.get(f"{name}_acceleration", 0.0),
            )
            for name, share in _MANOEUVRE.items()
            if camera > 0.0 and name in scales
        }
        self._scale = task.arm.limits.array("torque")
        self.unknown_arm = task.uncertainty.own_bodies or far["viscous_friction"] + far["coulomb_friction"] > 0.0
        indirect, self._jerks = config.control_mode != "torque", config.control_mode == "jerk"
        noisy = task.uncertainty.noisy and (self.unknown_arm or soonest < latest or self._jerks)
        friction = np.array([_expected(config.viscous_friction), _expected(config.coulomb_friction)])
        strength = task.arm.limits.array("torque")[0] / task.arm.chain_constants[0].sum()
        self._observer = ArmObserver(
            task.arm,
            ObserverSettings(
                period=config.control_period,
                steps=steps,
                unmodelled=_UNMODELLED[noisy] * strength,
                late=(round(soonest / config.physics_step), round(latest / config.physics_step)),
                noise=(far["encoder_noise"], far["velocity_noise"]),
                masses=max(abs(end) for end in ends(config.mass_error)),
                alike=not isinstance(config.mass_error, tuple),
                payload=far["payload"],
                friction=tuple(friction[:, 1].tolist()),
                likely_friction=tuple(friction[:, 0].tolist()),
            ),
        )
        own = task.arm.limits
        within = careful(own, _CALM[0]) if self.unknown_arm and self._jerks else own
        self._commands = NominalCommands(task, within) if indirect else None

    @staticmethod
    def wanted(task: Task) -> bool:
        """Whether the settings declare an uncertainty that robust tracking knows; a known payload is none."""
        entries = {entry.name for entry in task.layout.entries}
        if task.config.control_mode not in CONTROL_MODES or not entries >= _NEEDED:
            return False
        uncertainty = task.uncertainty
        return uncertainty.noisy or any(
            setting not in (0.0, None)
            for name, setting in dict(task.config).items()
            if name in ("mass_error", "viscous_friction", "coulomb_friction", "latency")
            or (name == "payload" and isinstance(setting, tuple))
        )

    def careful(self, limits: JointLimits) -> JointLimits:
        """The shares of some limits that are left for a motion."""
        return careful(limits, _CALM[self.unknown_arm] if self._jerks else CAREFUL["acceleration"])

    @property
    def waiting(self) -> int:
        """Control periods over which commands can be on their way."""
        return self._observer.settings.waiting

    @property
    def chases(self) -> bool:
        """Whether the target moves and is seen with noise."""
        return "part" in self._points

    def update(
        self, observations: Observation, before: RobustState | None, starts: NDArray[np.bool_]
    ) -> tuple[Observation, Estimate, RobustState, NDArray[np.bool_]]:
        """What the expert observes, the estimate, the state after it, and where an episode begins.

        Args:
            observations: ``(num_envs, size)``.
            before: the state after the last action, if any.
            starts: environments in which an episode begins, ``(num_envs,)``; one begins too where an observation does
                not continue the last episode.
        """
        layout, period = self._task.layout, self._task.config.control_period
        seen = layout.parse(observations)
        now, rows = Moment.of(self._task, seen), len(observations)
        if before is None or len(before.memory) != rows:
            jerks = np.zeros((rows, 2, self._observer.n_joints))
            before = RobustState(None, np.zeros((rows, self._observer.width)), {}, now, jerks)
        begins, memory = starts | ~now.continues(before.moment, self._task), before.memory.copy()
        jerks = before.jerks.copy()
        jerks[begins] = 0.0
        estimate = self._observer.update(memory, begins, seen["joint_position"], seen["joint_velocity"])
        points = self._filtered(seen, before, begins)
        seen["joint_position"], seen["joint_velocity"] = estimate.q, estimate.qd
        seen["joint_acceleration"] = jerks[:, 0] if self._jerks else estimate.qdd
        seen["time_left"] = seen["time_left"] - self.waiting * period
        for name in ("part", "obstacle"):
            if name in seen:
                late = estimate.late.reshape(-1, *[1] * (seen[name].ndim - 1))
                gain = late * seen.get("part_acceleration", 0.0) if name == "part" else 0.0
                seen[name] = seen[name] + late * (seen[f"{name}_velocity"] + 0.5 * gain)
                seen[f"{name}_velocity"] = seen[f"{name}_velocity"] + gain
        return layout.compose(seen), estimate, RobustState(before.expert, memory, points, now, jerks), begins

    def _filtered(self, seen: dict[str, Array], before: RobustState, begins: NDArray[np.bool_]) -> dict[str, Array]:
        """The filters of the points after a sample, which they replace by their estimates in ``seen``."""
        points = {}
        for name, kind in self._points.items():
            shape, rows = seen[name].shape, len(begins)
            place = seen[name].reshape(rows, -1, 2)
            rate = np.zeros_like(place)
            if f"{name}_velocity" in seen:
                rate = seen[f"{name}_velocity"].reshape(place.shape)
            known: Array | float = 0.0
            if kind.manoeuvre == 0.0 and f"{name}_acceleration" in seen:
                known = seen[f"{name}_acceleration"].reshape(place.shape)
            memory = before.points[name].copy() if before.points else np.zeros((rows, place.shape[1], WIDTH))
            kind.update(memory, begins, place, rate, known)
            seen[name] = memory[..., :2].reshape(shape)
            if f"{name}_velocity" in seen:
                seen[f"{name}_velocity"] = memory[..., 2:4].reshape(shape)
            points[name] = memory
        return points

    def act(
        self, state: RobustState, estimate: Estimate, shares: NDArray[np.float32], expert: Any
    ) -> tuple[NDArray[np.float32], RobustState]:
        """The action for what an expert wants, shares of the limits ``(num_envs, n)``, and the state after it.

        ``expert`` is the expert's own new state.
        """
        actions, tau = shares.astype(float), self._scale * shares
        if self._commands is not None:
            n = self._observer.n_joints
            now = state.memory[:, :n].copy(), state.memory[:, n : 2 * n].copy()
            actions, tau = self._commands.follow(estimate, now, state.jerks, actions)
        self._observer.send(state.memory, tau)
        return actions.astype(np.float32), replace(state, expert=expert)


def _expected(setting: Any) -> tuple[float, float]:
    """Mean and standard deviation of what is drawn from a range; around 0 for a single number, unknown to experts."""
    low, high = ends(setting)
    return (0.5 * (low + high), (high - low) / math.sqrt(12.0)) if low < high else (0.0, high)
