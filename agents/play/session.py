"""What one page plays: policies on the same episode, advanced together, changed by messages of the page."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, get_args

import numpy as np
from pydantic import Field

from agents.environments import check_names, make_batch, task_type
from agents.play.actor import PAYLOAD, YOU, Mouse, PlayedPolicy
from agents.policies.lookup import NamedPolicy, find_policy, shipped_policies
from envs.card import Metric, TaskCard, env_ids, task_card
from envs.experts import expert_names
from envs.settings import Settings, refuse_unknown
from planners import Infeasible, arm_names, load_arm

MOST_POLICIES = 3
SUITED = {"MinTorqueMove-v0": "lagrange", "ObstacleDodge-v0": "apf"}
"""The expert whose paper a task comes from, where that is not the first on its card."""


Coordinate = Annotated[float, Field(ge=-1e3, le=1e3)]
"""Of a point that a page sends, m."""


class Choice(Settings):
    """What a page plays.

    Attributes:
        env: id of the environment.
        policies: up to three.
        seed: of the episode.
        arm: a preset's name; the task's own when left out.
        payload: unknown point mass at the hand when the episode begins, kg.
        scenario: option of the reset.
    """

    env: str
    policies: tuple[str, ...] = Field(min_length=1, max_length=MOST_POLICIES)
    seed: int = Field(default=0, ge=0, le=2**53)
    arm: str | None = None
    payload: float | None = Field(default=None, ge=0.0, le=2.0)
    scenario: str | None = None


class Message(Settings):
    """What a page sends.

    Attributes:
        do: what to do.
        choice: for ``choose``.
        seed: for ``restart``.
        key: of a control, for ``change``.
        point: position, m, for ``change`` and ``mouse``.
        index: of the point of a control with several.
        number: for ``change`` of a number, and ``speed``.
    """

    do: Literal["choose", "restart", "run", "pause", "step", "speed", "change", "mouse"]
    choice: Choice | None = None
    seed: int | None = Field(default=None, ge=0, le=2**53)
    key: str | None = None
    point: tuple[Coordinate, Coordinate] | None = None
    index: int = Field(default=0, ge=0, le=8)
    number: float | None = None


@dataclass
class Session:
    """The state of one page.

    Attributes:
        allow_code: whether models of Stable-Baselines3 may be loaded.
        settings: of every environment, beside those of the choice.
        levels: difficulty levels of environments, by id.
        offered: policies that may be chosen beside those of the catalogue; None if any may, also ``module:name``.
        running: whether time goes on.
        speed: of the played time, as a share of real time.
    """

    allow_code: bool = False
    settings: Mapping[str, Any] = field(default_factory=dict)
    levels: Mapping[str, str] = field(default_factory=dict)
    offered: tuple[str, ...] | None = None
    running: bool = True
    speed: float = 1.0
    _played: list[PlayedPolicy] = field(default_factory=list)
    _choice: Choice | None = None
    _mouse: Mouse = field(default_factory=Mouse)
    _due: float = 0.0

    def take(self, message: Message) -> dict[str, Any] | None:
        """Do what a page asks for; the description of a new episode, if one has begun.

        Raises:
            ValueError: for what is impossible; the episode goes on.
        """
        match message.do:
            case "choose" if message.choice is not None:
                return self._choose(message.choice)
            case "restart" if self._choice is not None:
                seed = self._choice.seed if message.seed is None else message.seed
                return self._begin(self._choice.model_copy(update={"seed": seed}))
            case "run" | "pause":
                self.running = message.do == "run"
            case "step":
                self.running = False
                self._step()
            case "speed" if message.number is not None:
                self.speed = min(4.0, max(0.05, message.number))
            case "mouse":
                self._mouse.point = None if message.point is None else np.array(message.point)
            case "change" if message.key is not None:
                self._change(message)
        return None

    def advance(self, seconds: float) -> None:
        """Advance by so much real time, if it runs; at most a tenth of a second: what a slow policy delays is lost."""
        if not self.running or not self._played:
            return
        period = self._played[0].task.config.control_period
        self._due += min(0.1, seconds) * self.speed
        while self._due >= period:
            self._due -= period
            self._step()

    def stop(self, error: BaseException) -> str:
        """Pause after an error of a policy; what the page says of it."""
        self.running = False
        return failure(error)

    def frame(self) -> dict[str, Any]:
        """What the page draws now."""
        policies = [played.picture() for played in self._played]
        return {"kind": "frame", "running": self.running, "speed": self.speed, "policies": policies}

    def best_known(self) -> Callable[[], str] | None:
        """A function that computes the best known value of the episode, in words; None if there is none.

        It may take seconds, and uses nothing of the session.
        """
        choice, bound = self._choice, task_card(self._choice.env).bound if self._choice else None
        if choice is None or bound is None:
            return None
        card = task_card(choice.env)
        metric = next(each for each in card.metrics if each.key == bound.metric)
        settings, options = self._conditions(choice)

        def compute() -> str:
            with closing(make_batch(choice.env, 1, settings)) as env:
                batch: Any = env.unwrapped
                batch.reset(seed=[choice.seed], options=options)
                try:
                    value = bound.optimum(batch, 0, choice.seed)
                except Infeasible:
                    return ""
            return f"best known {_as_in_verdict(card, metric, value)}"

        return compute

    def close(self) -> None:
        """Close all environments."""
        for played in self._played:
            played.close()
        self._played = []

    def _step(self) -> None:
        for played in self._played:
            played.step()

    def _change(self, message: Message) -> None:
        """Change the episodes of all policies, or of none if one refuses a point."""
        if message.point is not None:
            place = str(message.key), np.array(message.point), message.index
            for played in self._played:
                played.check_change(*place)
            for played in self._played:
                played.change(*place)
            return
        for played in self._played:
            if message.number is None:
                raise ValueError(f"{message.key} needs a point or a number")
            elif message.key == PAYLOAD and played.heaviest is not None:
                played.load(message.number)
            else:
                played.change(str(message.key), message.number)

    def _choose(self, choice: Choice) -> dict[str, Any]:
        """Make the environments and policies of a choice; the old ones go on if that fails."""
        refuse_unknown([choice.env], env_ids(), "environment")  # before `task_card` would import a module
        if choice.arm is not None:
            refuse_unknown([choice.arm], arm_names(), "arm")
        if self.offered is not None:
            refuse_unknown(choice.policies, [*_policies(choice.env), *self.offered], "policy of this page")
        settings, options = self._conditions(choice)
        check_names(choice.env, settings, options)
        mouse = Mouse()
        made: list[PlayedPolicy] = []
        try:
            for name in choice.policies:
                named = NamedPolicy(YOU, YOU) if name == YOU else self._find(name, choice.env)
                made.append(PlayedPolicy(named, choice.env, settings, mouse))
                made[-1].check_payload(choice.payload or 0.0)
            before, self._played = self._played, made
            described = self._begin(choice)
        except BaseException:
            for played in made:
                played.close()
            if made is self._played:
                self._played = before
            raise
        self._mouse = mouse
        for played in before:
            played.close()
        return described

    def _conditions(self, choice: Choice) -> tuple[dict[str, Any], dict[str, Any]]:
        """Settings of the environments of a choice, and options of their resets."""
        given = {"arm": choice.arm, "payload": choice.payload}
        settings = {**self.settings, **{name: value for name, value in given.items() if value is not None}}
        options = {} if choice.scenario is None else {"scenario": choice.scenario}
        return task_card(choice.env).at_level(self.levels.get(choice.env), settings, options)

    def _find(self, name: str, env_id: str) -> NamedPolicy:
        return find_policy(name, env_id, allow_code=self.allow_code)

    def _begin(self, choice: Choice) -> dict[str, Any]:
        """Begin the episode of a choice; its description."""
        _, options = self._conditions(choice)
        for played in self._played:
            played.begin(choice.seed, options)
        self._choice, self._due = choice, 0.0
        task, card, heaviest = self._played[0].task, self._played[0].card, self._played[0].heaviest
        controls = [{"key": each.key, "title": each.title, "span": each.span} for each in card.controls]
        if heaviest is not None:
            controls.append({"key": PAYLOAD, "title": "unknown payload (kg)", "span": (0.0, heaviest)})
        return {
            "kind": "episode",
            "choice": choice.model_dump(),
            "view": list(task.view),
            "period": task.config.control_period,
            "controls": controls,
        }


def _as_in_verdict(card: TaskCard, metric: Metric, value: float) -> str:
    """A value of a metric with the digits and the unit of the verdict, or beside its title if that does not say it."""
    if card.picture is not None:
        infos = (defaultdict(float, {metric.key: number, "is_success": True}) for number in (value, value + 1.0))
        numbers = (re.findall(r"\d[\d.]* [^\s,]+", card.picture.outcome(info, 0.0)) for info in infos)
        if said := next((one for one, other in zip(*numbers, strict=True) if one != other), None):
            return str(said)
    return f"{metric.title}: {metric.factor * value:.3g}"


def failure(error: BaseException) -> str:
    """What the page says of an error of a policy."""
    return f"a policy failed: {type(error).__name__}: {' '.join(str(error).split())}"[:500]


def first_policy(env_id: str) -> str:
    """The policy with which a page begins a task."""
    return SUITED.get(env_id, expert_names(env_id)[0])


def catalogue() -> list[dict[str, Any]]:
    """What a page can choose from: the tasks with their policies, arms and scenarios."""
    return [_described(env_id) for env_id in env_ids()]


def _policies(env_id: str) -> list[str]:
    """Names of the policies that every page offers for a task."""
    return [*shipped_policies(env_id), *expert_names(env_id), YOU]


def _described(env_id: str) -> dict[str, Any]:
    card = task_card(env_id)
    scenarios = task_type(env_id).options_type.model_fields.get("scenario")
    return {
        "env": env_id,
        "policies": _policies(env_id),
        "first": first_policy(env_id),
        "arms": [name for name in arm_names() if load_arm(name).n_joints in card.links],
        "scenarios": [name for name in get_args(scenarios.annotation) if name != "random"] if scenarios else [],
    }
