"""An episode as pictures need it: posture, target, discs and what the task is about, control period by period."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np

from agents.commands.rollout import Info, play
from agents.policies.lookup import NamedPolicy
from envs.task import Task
from planners import Arm
from planners.typing import Array


@dataclass(frozen=True)
class Story:
    """What a task is about.

    Attributes:
        title: of the measure, with its unit.
        measure: one number that a curve over time shows, from an environment's record.
        outcome: what became of an episode, in words, from its last info and its duration (s).
        arrival: when the task was fulfilled, s, from the last info of a success; None for the end of the episode.
        logarithmic: whether the measure spans decades.
        tolerance: setting that holds the largest measure that counts as success, m; None if there is none.
        rate: whether the curve is the measure's derivative.
        belt: whether the target is a part on a belt.
    """

    title: str
    measure: Callable[[Any], float]
    outcome: Callable[[Info, float], str]
    arrival: str | None = None
    logarithmic: bool = False
    tolerance: str | None = None
    rate: bool = False
    belt: bool = False


def _settling(info: Info, duration: float) -> str:
    if math.isfinite(info["settling_time"]):
        return f"settled at {info['settling_time']:.2f} s"
    return f"not settled after {duration:.1f} s"


def _effort(info: Info, duration: float) -> str:
    if info["is_success"]:
        return f"torque {100.0 * info['quintic_ratio']:.0f} % of the quintic's"
    return f"missed the goal by {info['angle_error']:.2g} rad"


def _dodging(info: Info, duration: float) -> str:
    if info["collision"]:
        return f"collided at {duration:.2f} s"
    clearance = f"least clearance {1e3 * info['min_clearance']:.0f} mm"
    if info["is_success"]:
        return f"at the goal after {info['time_to_goal']:.2f} s,\n{clearance}"
    return f"not at the goal after {duration:.1f} s,\n{clearance}"


def _following(info: Info, duration: float) -> str:
    if math.isfinite(info["tip_rms"]):
        return f"tip error {1e3 * info['tip_rms']:.1f} mm RMS,\n{1e3 * info['tip_max']:.1f} mm at worst"
    return f"a joint ran away at {duration:.1f} s"


STORIES: dict[str, Story] = {
    "ConveyorTrack-v0": Story(
        "distance from hand to part (mm)",
        lambda env: 1e3 * float(env["error"]),
        _settling,
        arrival="settling_time",
        logarithmic=True,
        tolerance="position_tolerance",
        belt=True,
    ),
    "MinTorqueMove-v0": Story(
        "sum of the joints' |torque| (N m)", lambda env: float(env["torque_l1"]), _effort, rate=True
    ),
    "ObstacleDodge-v0": Story(
        "clearance between arm and disc (mm)",
        lambda env: 1e3 * float(env["clearance"]),
        _dodging,
        arrival="time_to_goal",
    ),
    "ExcavatorPayload-v0": Story(
        "distance from tip to reference (mm)",
        lambda env: 1e3 * float(env["tip_error"]),
        _following,
        logarithmic=True,
    ),
}
"""What each task is about."""


@dataclass(frozen=True, eq=False)
class Course:
    """One episode of one policy; samples are at the start and the ends of its control periods.

    Attributes:
        policy: its name.
        env_id: where.
        arm: the robot.
        t: time since the start, ``(samples,)``, s.
        joints: positions of the joints from the base on, and of the hand, ``(samples, n + 1, 2)``, m.
        target: where the hand should be, ``(samples, 2)``, m.
        discs: centres of the discs, ``(samples, discs, 2)``, m; none in tasks without them.
        radii: of the discs, ``(discs,)``, m.
        measure: what the task's story tells, ``(samples,)``.
        tolerance: largest measure that counts as success, if there is one.
        info: the last one of the episode, with its return and length.
    """

    policy: str
    env_id: str
    arm: Arm
    t: Array
    joints: Array
    target: Array
    discs: Array
    radii: Array
    measure: Array
    tolerance: float | None
    info: Info

    @property
    def duration(self) -> float:
        """Of the episode, s."""
        return float(self.t[-1])

    @property
    def arrival(self) -> float:
        """When the task was fulfilled, or else when the episode ended, s."""
        key = STORIES[self.env_id].arrival
        return float(self.info[key]) if key is not None and self.info["is_success"] else self.duration

    @property
    def outcome(self) -> str:
        """What became of the episode, in words."""
        return STORIES[self.env_id].outcome(self.info, self.duration)

    def sample_at(self, time: float) -> int:
        """Number of the sample nearest to a time (s)."""
        return int(np.abs(self.t - time).argmin())


def run_course(env_id: str, named: NamedPolicy, seed: int, options: Info) -> Course:
    """Run one episode of a policy and keep what a picture of it needs.

    Raises:
        ValueError: for a seed or options that the environment does not know.
    """
    story = STORIES[env_id]
    with closing(gym.make(env_id, **named.settings({}))) as env:
        watched = _Watched(env, story)
        info = play(watched, named.policy, seed, options)
        task: Task = env.unwrapped.task  # type: ignore[attr-defined]
        period, record = task.config.control_period, task.batch[0]
        t = np.arange(len(watched.joints), dtype=np.float64) * period
        measure = np.array(watched.measure)
        if story.rate:
            rates = np.diff(measure) / period
            measure = np.append(rates, rates[-1])
        return Course(
            policy=named.name,
            env_id=env_id,
            arm=task.arm,
            t=t,
            joints=np.array(watched.joints),
            target=np.array(watched.target),
            discs=np.array(watched.discs),
            radii=record["radii"].copy() if "radii" in _fields(record) else np.empty(0),
            measure=measure,
            tolerance=None if story.tolerance is None else 1e3 * getattr(task.config, story.tolerance),
            info=info,
        )


class _Watched(gym.Wrapper[Any, Any, Any, Any]):
    """Notes the state of the only environment whenever there is a new one."""

    def __init__(self, env: gym.Env[Any, Any], story: Story) -> None:
        super().__init__(env)
        self._task: Task = env.unwrapped.task  # type: ignore[attr-defined]
        self._story = story
        self.joints: list[Array] = []
        self.target: list[Array] = []
        self.discs: list[Array] = []
        self.measure: list[float] = []

    def reset(self, **arguments: Any) -> tuple[Any, Info]:
        result = super().reset(**arguments)
        self._note()
        return result

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, Info]:
        result = super().step(action)
        self._note()
        return result

    def _note(self) -> None:
        env = self._task.batch[0]
        joints = self._task.arm.joint_positions(env["q"])
        joints[-1] = self._task.hand_position(0)
        self.joints.append(joints)
        self.target.append(_target(self._task, env))
        self.discs.append(env["discs"].copy() if "discs" in _fields(env) else np.empty((0, 2)))
        self.measure.append(self._story.measure(env))


def _target(task: Task, env: Any) -> Array:
    """Where the hand should be now: on the part, on the reference, or at the goal, in space or by its joint angles."""
    for name in ("part_position", "wanted_tip"):
        if name in _fields(env):
            return np.array(env[name])
    goal = np.array(env["goal"])
    return goal if len(goal) == 2 else task.arm.forward_kinematics(goal)


def _fields(env: Any) -> tuple[str, ...]:
    return env.dtype.names or ()
