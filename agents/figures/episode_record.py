"""The record of an episode: posture, target, discs and the task's measure, control period by control period."""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass

import numpy as np

from agents.environments import make_one
from agents.policies.lookup import NamedPolicy
from agents.policies.play import Info, play
from envs.card import Picture, task_card
from envs.task import Task
from planners import Arm
from planners.typing import Array


@dataclass(frozen=True, eq=False)
class EpisodeRecord:
    """One episode of one policy; samples are at the start and at the end of each control period."""

    policy: str
    env_id: str
    picture: Picture  # what figures of the task show
    arm: Arm
    t: Array  # time since the start, ``(samples,)``, s
    joints: Array  # positions of the joints from the base on, and of the hand, ``(samples, n + 1, 2)``, m
    target: Array  # where the hand should be, ``(samples, 2)``, m
    discs: Array  # centres of the discs, ``(samples, discs, 2)``, m; none in tasks without them
    radii: Array  # of the discs, ``(discs,)``, m
    second_arm: Array  # joints and hand of an arm to avoid, ``(samples, 3, 2)``, m; ``(samples, 0, 2)`` without one
    measure: Array  # the measure of the picture, ``(samples,)``
    tolerance: float | None  # largest measure that counts as success, if there is one
    info: Info  # the last one of the episode, with its return and length

    @property
    def duration(self) -> float:
        """Of the episode, s."""
        return float(self.t[-1])

    @property
    def arrival(self) -> float:
        """When a success was reached, or else the end of the episode, s."""
        key = self.picture.arrival
        return float(self.info[key]) if key is not None and self.info["is_success"] else self.duration

    @property
    def outcome(self) -> str:
        """The result of the episode, in words."""
        return self.picture.outcome(self.info, self.duration)

    def sample_at(self, time: float) -> int:
        """Index of the sample nearest to a time (s)."""
        return int(np.abs(self.t - time).argmin())


def picture_of(env_id: str) -> Picture:
    """What figures of a task show, from its card; a ValueError if there is no such task, or no picture on its card."""
    picture = task_card(env_id).picture
    if picture is None:
        raise ValueError(f"the card of {env_id} has no picture, so there is nothing to draw")
    return picture


def record_episode(
    env_id: str, named: NamedPolicy, seed: int, options: Info, settings: Info | None = None
) -> EpisodeRecord:
    """Run one episode of a policy and record what a picture of it needs; raises as `picture_of`."""
    picture = picture_of(env_id)
    with closing(make_one(env_id, named.settings(settings or {}))) as env:
        task: Task = env.unwrapped.task  # type: ignore[attr-defined]
        samples: list[tuple[Array, Array, Array, Array, float]] = []

        def sample(steps: int, ended: bool) -> None:
            state = task.batch[0]
            joints = task.arm.joint_positions(state["q"])
            joints[-1] = task.hand_position(0)
            discs = picture.discs(task, state)[0] if picture.discs else np.empty((0, 2))
            second = picture.second_arm(task, state) if picture.second_arm else np.empty((0, 2))
            samples.append((joints, picture.target(task, state), discs, second, picture.measure(state)))

        info = play(env, named.policy, seed, options, sample)
        joints, target, discs, second_arm, measure = (np.array(values) for values in zip(*samples, strict=True))
        period = task.config.control_period
        if picture.rate:
            rates = np.diff(measure) / period
            measure = np.append(rates, rates[-1])
        return EpisodeRecord(
            policy=named.name,
            env_id=env_id,
            picture=picture,
            arm=task.arm,
            t=np.arange(len(samples), dtype=np.float64) * period,
            joints=joints,
            target=target,
            discs=discs,
            radii=picture.discs(task, task.batch[0])[1] if picture.discs else np.empty(0),
            second_arm=second_arm,
            measure=measure,
            tolerance=None if picture.tolerance is None else 1e3 * getattr(task.config, picture.tolerance),
            info=info,
        )
