"""The card of a task: all that experts, evaluation, training and figures need to know of it, declared once.

`register` adds a task and its card under a Gymnasium id; the tasks that come with planarm go through it too.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import TYPE_CHECKING, Any

import gymnasium as gym

if TYPE_CHECKING:
    from envs.experts.base import Expert
    from envs.task import Task
    from planners.typing import Array

Info = Mapping[str, Any]


@dataclass(frozen=True)
class Metric:
    """A number that ``info`` holds at the end of an episode, with its own column in tables.

    Boolean metrics are shown as a share with its interval, the others as a median.

    Attributes:
        key: in ``info``.
        title: of the column, with its unit.
        factor: from SI to that unit.
        primary: whether the task's episodes are compared by it; one metric a task.
        lower_is_better: the direction.
    """

    key: str
    title: str
    factor: float = 1.0
    primary: bool = False
    lower_is_better: bool = True


@dataclass(frozen=True)
class Bound:
    """The best known value of one metric.

    Attributes:
        metric: its key.
        meaning: what the value is, for captions.
        optimum: the best known value for a seed, from a vector environment, the index of the environment in it that
            is at the start of that seed's episode, and the seed; `planners.Infeasible` where none is known.
        lower: with the same arguments, a certified lower bound: no motion is better. NaN where none is known.
        of_motions: whether the best known value is that of a motion, so that a policy's episode that is better takes
            its place; not where it depends on noise.
    """

    metric: str
    meaning: str
    optimum: Callable[[Any, int, int], float]
    lower: Callable[[Any, int, int], float] | None = None
    of_motions: bool = True


@dataclass(frozen=True)
class Picture:
    """What figures show of an episode, read from an environment's record in `Task.batch`.

    Attributes:
        title: of the curve over time, with its unit.
        measure: the curve's value, from the record.
        outcome: the result of an episode in words, from its last info and its duration (s).
        target: where the hand should be, ``(2,)``, m, from the task and the record.
        discs: centres ``(discs, 2)`` and radii ``(discs,)`` of the obstacles, m, from the task and the record.
        second_arm: joints and hand of an arm to avoid, ``(n, 2)``, m, from the task and the record; none if n is 0.
        arrival: key of the time at which a success was reached, s; None for the end of the episode.
        logarithmic: whether the measure spans decades.
        tolerance: setting that holds the largest measure that counts as success, m.
        rate: whether the curve is the derivative of the measure.
        belt: whether the target rides on a belt.
    """

    title: str
    measure: Callable[[Any], float]
    outcome: Callable[[Info, float], str]
    target: Callable[[Any, Any], Array]
    discs: Callable[[Any, Any], tuple[Array, Array]] | None = None
    second_arm: Callable[[Any, Any], Array] | None = None
    arrival: str | None = None
    logarithmic: bool = False
    tolerance: str | None = None
    rate: bool = False
    belt: bool = False


@dataclass(frozen=True)
class Control:
    """Something that a spectator may change while an episode runs: a number, or points that are dragged.

    Attributes:
        key: its name.
        title: for labels, with the unit of a number.
        read: the number, or the points ``(k, 2)``, m, from the task and the record of an environment.
        write: writes a number, or the position ``(2,)``, m, and the index of a point (in this order, after the task and
            the record of an environment) into the record; gives whether that is done: False while the arm must first
            come to rest. A ValueError for what is impossible.
        span: lowest and highest number; None for points.
        replans: whether policies have to plan anew after a change.
    """

    key: str
    title: str
    read: Callable[[Any, Any], Any]
    write: Callable[..., bool]
    span: tuple[float, float] | None = None
    replans: bool = True


@dataclass(frozen=True)
class Level:
    """How hard a task is made: settings of the environment and options of each reset.

    Attributes:
        meaning: what is harder than by default, for tables.
        settings: of the environment, ``gym.make(id, **settings)``.
        options: of the reset.
        every_arm: whether it is one for every arm; not where it has lengths, speeds or times of the task's own.
    """

    meaning: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)
    every_arm: bool = True


@dataclass(frozen=True)
class TaskCard:
    """What other packages need to know of a task.

    Attributes:
        metrics: columns of its tables, in order.
        experts: how each scripted expert is made from the task, by name; "random" is there for every task.
        control_modes: in which the experts act; the default first.
        replan_every: control periods between two plans of a user's own planner; None to keep the first.
        bound: the best known value of a metric, if one can be computed.
        links: numbers of links of the arms that the task bears, in the setting ``arm``; none if it keeps its own.
        recipe: training configuration: the name of a shipped one, or the path of a YAML file.
        constant_entries: entries of the observation that may stay constant over an episode with default settings.
        picture: what figures show.
        controls: what a spectator may change while an episode runs.
        levels: difficulty levels by name, in the order of tables: harder tasks, then uncertainty, all of it last.
    """

    metrics: tuple[Metric, ...]
    experts: Mapping[str, Callable[[Any], Expert]]
    control_modes: tuple[str, ...] = ("torque",)
    replan_every: int | None = None
    bound: Bound | None = None
    links: tuple[int, ...] = ()
    recipe: str | None = None
    constant_entries: frozenset[str] = frozenset()
    picture: Picture | None = None
    controls: tuple[Control, ...] = ()
    levels: Mapping[str, Level] = field(default_factory=dict)

    def at_level(
        self, name: str | None, settings: Mapping[str, Any], options: Mapping[str, Any]
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Settings and reset options at a level, with some of them given in place of the level's.

        Raises:
            ValueError: for an unknown level, with the nearest one; for one that the given arm does not have.
        """
        if name is None:
            return dict(settings), dict(options)
        from envs.settings import refuse_unknown

        refuse_unknown([name], self.levels, "level")
        level = self.levels[name]
        if settings.get("arm") is not None and not level.every_arm:
            given = ", ".join(f"{option}={value}" for option, value in level.options.items())
            raise ValueError(
                f"level {name!r} is one of the task's own arm ({given}); leave it out, and give options that suit yours"
            )
        return {**level.settings, **settings}, {**level.options, **options}

    @property
    def primary(self) -> Metric | None:
        """The metric by which episodes are compared, if one is marked."""
        return next((metric for metric in self.metrics if metric.primary), None)


_CARDS: dict[str, TaskCard | str] = {}


def register(env_id: str, task: type[Task] | str, card: TaskCard | str) -> None:
    """Register a task with Gymnasium, single and vector, and its card; again for the same id replaces both.

    Args:
        env_id: the Gymnasium id, such as ``"Swing-v0"``; the task's own `env_id`.
        task: the `Task` class. As ``"module:Name"`` it is not imported before it is made, and the class ``NameEnv``
            beside it is the single environment.
        card: its card, or ``"module:NAME"`` of it.

    Raises:
        TypeError: if the card is none.
        ValueError: if the class has another `env_id`, or planarm itself has a task of this id.
    """
    if not isinstance(card, TaskCard | str):
        raise TypeError(f"the card of {env_id} is {card!r:.80}; give a TaskCard, or the name of one")
    if not isinstance(task, str) and task.env_id != env_id:
        raise ValueError(f"{task.__name__}.env_id is {task.env_id!r}, not {env_id!r}; make them the same")
    single, vector = "envs.environment:PlanarArmEnv", "envs.vector_environment:PlanarArmVectorEnv"
    if isinstance(task, str):
        single = f"{task}Env"
    elif task.__module__ != "__main__" and getattr(sys.modules[task.__module__], task.__qualname__, None) is task:
        task = f"{task.__module__}:{task.__qualname__}"  # what a dataset can hold, and another process find
    before = gym.registry[env_id].kwargs.get("task_type") if env_id in gym.registry else None
    if isinstance(before, str) and before.startswith("envs.") and task != before:
        raise ValueError(f"{env_id} is a task of planarm; give your own another id")
    if before != task:
        gym.registry.pop(env_id, None)
        gym.register(env_id, entry_point=single, vector_entry_point=vector, kwargs={"task_type": task})
    _CARDS[env_id] = card


def env_ids() -> list[str]:
    """Ids of all registered tasks, sorted."""
    return sorted(_CARDS)


def task_card(env_id: str) -> TaskCard:
    """The card of a task by its id; ``"module:id"`` imports the module first, as `gym.make` does.

    Raises:
        ValueError: if no task has this id, with the nearest one that there is.
    """
    module, colon, name = env_id.rpartition(":")
    if colon:
        import_module(module)
        env_id = name
    if env_id not in _CARDS:
        from envs.settings import refuse_unknown

        refuse_unknown([env_id], _CARDS, "environment")
    card = _CARDS[env_id]
    if isinstance(card, str):
        card = _CARDS[env_id] = load(card)
    return card


def load(place: str) -> Any:
    """Import what ``"module:name"`` names."""
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)
