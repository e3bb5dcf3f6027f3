"""One policy in its own environment, step by step, with what a page shows of it."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.environments import make_one
from agents.policies.lookup import NamedPolicy
from agents.policies.policy import Actor
from envs.card import Control, TaskCard, task_card
from envs.experts.base import Expert
from envs.experts.planning import PlanningExpert
from envs.experts.reactive import FollowerExpert
from envs.rendering.document import scene_document
from envs.task import Task
from planners import Infeasible, MotionProblem, Trajectory
from planners.typing import Array

YOU = "you"
"""Name of the policy whose hand follows the mouse."""

PAYLOAD = "payload"
"""Key of the payload among the numbers that can be changed."""

TRAIL = 90
"""Hand positions that are shown behind the hand."""

MOUSE_BANDWIDTH = 6.0
"""Natural frequency with which the hand follows the mouse, rad/s."""


@dataclass
class Mouse:
    """Where the mouse is, m; None before it is over the picture."""

    point: Array | None = None


@dataclass
class PlayedPolicy:
    """A policy that acts in an environment of its own.

    Attributes:
        named: the policy.
        env_id: of the environment.
        settings: of the environment, besides those that the policy carries.
        mouse: what "you" follows.
        changed: whether a control has changed the episode, so that it no longer is that of its seed.
        info: the last one.
        ended: whether the episode is over.
    """

    named: NamedPolicy
    env_id: str
    settings: Mapping[str, Any]
    mouse: Mouse
    changed: bool = False
    ended: bool = True
    info: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.card: TaskCard = task_card(self.env_id)
        self._enter(make_one(self.env_id, self.named.settings(self.settings)))
        self._waiting: dict[str, tuple[Any, ...]] = {}
        self._trail: list[Array] = []
        self._own_payload = self.settings.get("payload") or 0.0

    def _enter(self, env: Any) -> None:
        """Act in an environment from now on."""
        self._env = env
        self.task: Task = env.unwrapped.task
        policy: Any = self._follower() if self.named.name == YOU else self.named.policy
        self._actor = self._acting = Actor(policy, env, self.named.name)
        self._brake: Actor | None = None

    def begin(self, seed: int, options: Mapping[str, Any]) -> None:
        """Begin the episode of a seed; raises as ``reset``."""
        self._start: dict[str, Any] = {"seed": seed, "options": dict(options)}
        self._observation, self.info = self._env.reset(**self._start)
        self._state: Any = None
        self._begins, self.ended, self._refused = True, False, ""
        self.changed = (self.settings.get("payload") or 0.0) != self._own_payload
        self._waiting.clear()
        self._trail.clear()

    def step(self) -> None:
        """Advance by one control period; a finished episode stands still."""
        for key, arguments in list(self._waiting.items()):
            try:
                self.change(key, *arguments)
            except ValueError as error:  # possible from where it was asked for, but not from where the arm rests
                self._refused, self._begins = str(error), True
        if self.ended:
            return
        acting = self._braking() if self._waiting else self._actor
        if acting is not self._acting:
            self._acting, self._state = acting, None
        observations: NDArray[Any] = self._observation[None]
        actions, self._state = acting.act(observations, self._state, np.array([self._begins]))
        self._begins = False
        self._trail = [*self._trail[1 - TRAIL :], self.task.hand_position(0)]
        self._observation, _, terminated, truncated, self.info = self._env.step(actions[0])
        self.ended = bool(terminated or truncated)

    def change(self, key: str, *arguments: Any) -> None:
        """Change what a control of the task's card names; once the arm rests, if it has to.

        Raises:
            ValueError: for an unknown key, or a change that is impossible.
        """
        control = self._control(key)
        self._waiting.pop(key, None)
        self._refused = ""
        if not self.task.change(0, control, *arguments):
            self._waiting[key] = arguments
        elif control.replans:
            self._begins, self._state, self.ended = True, None, False
            self._observation = self._env.unwrapped.resume()
        self.changed = True

    def check_change(self, key: str, point: Array, index: int) -> None:
        """Raise the ValueError of `change` for a point, also while the arm moves: it is tried at the start."""
        control, env = self._control(key), self._env.unwrapped
        state = env.get_state()
        try:
            self._env.reset(**self._start)
            self.task.change(0, control, point, index)
        finally:
            env.set_state(state)

    @property
    def heaviest(self) -> float | None:
        """Largest payload that `load` takes, kg; None where it is not the task's to be loaded."""
        return 0.5 * self.task.arm.masses[-1] if self.card.links else None

    def check_payload(self, mass: float) -> None:
        """Raise ValueError for an unknown payload, kg, that `load` does not take; 0 is nowhere refused."""
        if not 0.0 <= mass <= (self.heaviest or 0.0):
            raise ValueError(f"payload {mass} kg must be from 0 to {self.heaviest or 0.0:g} kg")

    def load(self, mass: float) -> None:
        """Give the hand another unknown payload, kg; nobody plans anew.

        Raises:
            ValueError: for a payload that is not allowed.
        """
        self.check_payload(mass)
        self.settings = {**self.settings, "payload": mass}
        env, before = make_one(self.env_id, self.named.settings(self.settings)), self._env
        env.reset(seed=0)
        unwrapped: Any = env.unwrapped
        unwrapped.task.take_over(self.task)
        if not self.ended:
            self._observation = unwrapped.resume()
        self._enter(env)
        before.close()
        self.changed = True

    def picture(self) -> dict[str, Any]:
        """What a page draws: scene, plan ahead, points that can be dragged, numbers of the controls, and the result."""
        record = self.task.batch[0]
        return {
            "name": self.named.name,
            "scene": scene_document(self.task.scene(0, self._trail)),
            "plan": _rounded(self._plan()),
            "points": {each.key: _rounded(each.read(self.task, record)) for each in self._controls(points=True)},
            "numbers": self._numbers(record),
            "ended": self.ended,
            "changed": self.changed,
            "refusal": "" if self.ended or self._waiting else self._refused or self._refusal(),
            "outcome": self._outcome() if self.ended else "",
            "success": bool(self.info.get("is_success", False)),
        }

    def close(self) -> None:
        """Close the environment."""
        self._env.close()

    def _control(self, key: str) -> Control:
        control = next((each for each in self.card.controls if each.key == key), None)
        if control is None:
            raise ValueError(f"{self.env_id} has no control {key}")
        return control

    def _numbers(self, record: Any) -> dict[str, float]:
        numbers = {each.key: each.read(self.task, record) for each in self._controls(points=False)}
        return numbers if self.heaviest is None else {**numbers, PAYLOAD: float(record["payload"])}

    def _controls(self, *, points: bool) -> list[Control]:
        return [each for each in self.card.controls if (each.span is None) == points]

    def _plan(self) -> Array | None:
        """Positions of the hand that are planned, ``(k, 2)``, m; None without a plan."""
        policy = self._actor.policy
        planned = policy.planned() if isinstance(policy, Expert) and not self._waiting else None
        if planned is None or self.ended:
            return None
        thinned = planned[np.unique(np.linspace(0, len(planned) - 1, 40).astype(int))]
        return self.task.arm.forward_kinematics(thinned)

    def _outcome(self) -> str:
        picture = self.card.picture
        if picture is None:
            return "solved" if self.info.get("is_success") else "not solved"
        return picture.outcome(self.info, int(self.task.batch["step"][0]) * self.task.config.control_period)

    def _refusal(self) -> str:
        """Why the policy has no motion; empty if it has one."""
        return str(getattr(self._actor.policy, "refusal", ""))

    def _follower(self) -> FollowerExpert:
        """The hand is drawn to the mouse."""
        task = self.task

        def goal(seen: dict[str, Array]) -> tuple[Array, Array, Array]:
            still = np.zeros((1, 2))
            hand = task.arm.forward_kinematics(seen["joint_position"])
            return (hand if self.mouse.point is None else self.mouse.point[None]), still, still

        return FollowerExpert(task, goal, MOUSE_BANDWIDTH)

    def _braking(self) -> Actor:
        """A policy that brings the arm to rest: a planner that never has a plan; its own if experts cannot act."""
        if self._brake is None:
            self._brake = self._actor
            with suppress(ValueError):
                self._brake = Actor(PlanningExpert(self.task, _no_plan), self._env, "brake")
        return self._brake


def _no_plan(problem: MotionProblem) -> Trajectory:
    raise Infeasible("limits", "the arm is to come to rest")


def _rounded(points: Any) -> list[list[float]] | None:
    return None if points is None else np.round(np.asarray(points, dtype=float), 4).tolist()
