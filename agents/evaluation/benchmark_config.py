"""What a benchmark runs: the settings of ``configs/benchmark.yaml``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Self

from pydantic import Field, PrivateAttr, field_validator, model_validator

import envs
from agents.environments import MOST_EPISODES, SEED_MOST, import_env, portable
from agents.yaml_config import load_config, refuse_twice
from envs.experts import ADAPTIVE, expert_names, is_expert
from envs.settings import Settings, refuse_unknown
from planners.checks import brief

SHIPPED_CONFIG = "benchmark"  # name of the configuration of the leaderboard


class Published(Settings):
    """A published result, for its own row of the leaderboard.

    Attributes:
        source: where it was published.
        settling_time: s.
        note: differences that matter for the comparison.
    """

    source: str
    settling_time: float = Field(gt=0.0)
    note: str = ""


class BenchmarkTask(Settings):
    """One task of a benchmark.

    Attributes:
        env: id of the environment, ``module:id`` for a task of your own.
        level: difficulty level on the task's card; its settings and options are added to those below.
        name: title in the leaderboard; id and level when left out.
        env_config: settings of the environment.
        options: of each reset.
        policies: those of this task, if not those of the benchmark.
        control_modes: in which experts act, by name, where that is not the mode of ``env_config``.
        episodes: number of episodes, if not that of the benchmark.
        bound_episodes: number of episodes whose bound is computed, if not that of the benchmark.
        published: a figure from a paper, for its own row.
    """

    env: str
    level: str | None = None
    name: str = ""
    env_config: dict[str, Any] = Field(default_factory=dict)
    options: dict[str, Any] = Field(default_factory=dict)
    policies: tuple[str, ...] | None = Field(None, min_length=1)
    control_modes: dict[str, str] = Field(default_factory=dict)
    episodes: int | None = Field(None, ge=1, le=MOST_EPISODES)
    bound_episodes: int | None = Field(None, ge=0)
    published: Published | None = None
    _changed: dict[str, Any] = PrivateAttr(default_factory=dict)

    @field_validator("env")
    @classmethod
    def _imported(cls, env: str) -> str:
        """The id; a module in front of it is imported."""
        return import_env(env)

    @field_validator("env_config")
    @classmethod
    def _portable(cls, env_config: dict[str, Any]) -> dict[str, Any]:
        """The settings as they go into JSON."""
        return portable(env_config)

    @model_validator(mode="before")
    @classmethod
    def _at_level(cls, given: Any) -> Any:
        """The settings and options of the level beside the given ones."""
        if not (isinstance(given, Mapping) and given.get("level") and isinstance(given.get("env"), str)):
            return given
        own = given.get("env_config", {}), given.get("options", {})
        settings, options = envs.task_card(import_env(given["env"])).at_level(given["level"], *own)
        return {**given, "env_config": settings, "options": options}

    @model_validator(mode="after")
    def _one_mode(self) -> Self:
        """Control modes of experts that there are, and of no policy two."""
        if not self.control_modes:
            return self
        refuse_unknown(self.control_modes, expert_names(self.env), f"{self.env} expert")
        if "control_mode" in self.env_config:
            raise ValueError(
                f"control_mode {self.env_config['control_mode']!r} for every policy contradicts control_modes "
                f"{self.control_modes}; give one of them"
            )
        return self

    def changed(self, name: str, more: Mapping[str, Any]) -> Self:
        """The task with more settings (``env_config``) or reset options (``options``); `beside_title` says which."""
        before = getattr(self, name)
        changed = self.model_copy(update={name: {**before, **more}})
        changed._changed = self._changed | {key: value for key, value in more.items() if before.get(key) != value}
        return changed

    @property
    def title(self) -> str:
        """Its title in the leaderboard."""
        return self.name or (f"{self.env}/{self.level}" if self.level else self.env)

    @property
    def beside_title(self) -> str:
        """Settings and reset options that the title does not name, such as "payload 0.2, horizon 2"; "" for none."""
        level = envs.task_card(self.env).levels[self.level] if self.level else None
        named = (level.settings, level.options) if level else ({}, {})
        parts = zip((self.env_config, self.options), map(portable, map(dict, named)), strict=True)
        own = [
            (name, value) for given, of_level in parts for name, value in given.items() if value != of_level.get(name)
        ]
        if self.name:
            own = list(self._changed.items())
        return ", ".join(f"{name} {brief(value)}" for name, value in own)


class Quick(Settings):
    """The part of a benchmark that `planarm benchmark` runs without ``--full``: its first episodes.

    Attributes:
        episodes: largest number of episodes of each policy on each task.
        bound_episodes: largest number of episodes whose bound is computed.
        first: title of the task that is run first, unless other policies are asked for.
    """

    episodes: int = Field(ge=1, le=MOST_EPISODES)
    bound_episodes: int = Field(ge=0)
    first: str | None = None


class BenchmarkConfig(Settings):
    """A benchmark: every policy on every task, on the same seeds.

    Attributes:
        episodes: of each policy on each task.
        bound_episodes: number of episodes whose bound is computed.
        seed: of the first episode; each further episode has the next.
        num_envs: episodes that run at once.
        policies: names of experts, ``agent`` for the agent shipped for the environment, paths of runs and agents,
            ``module:name`` for your own.
        tasks: on which they act.
        replays: number of seeds of each task whose episodes are recorded for the report, of every policy.
        quick: what is run without ``--full``; everything if left out.
    """

    episodes: int = Field(ge=1, le=MOST_EPISODES)
    bound_episodes: int = Field(ge=0)
    seed: int = Field(0, ge=0, le=SEED_MOST)
    num_envs: int = Field(256, ge=1)
    policies: tuple[str, ...] = Field(min_length=1)
    tasks: tuple[BenchmarkTask, ...] = Field(min_length=1)
    replays: int = Field(8, ge=0)
    quick: Quick | None = None

    @model_validator(mode="after")
    def _once(self) -> Self:
        """Each policy and each task once."""
        for policies in (self.policies, *(task.policies or () for task in self.tasks)):
            refuse_twice(policies, "policy")
        refuse_twice([task.title for task in self.tasks], "task")
        return self

    def shortened(self, *, in_order: bool = False) -> BenchmarkConfig:
        """The benchmark that is run without ``--full``, with the order of tasks of the whole one on request.

        It is the whole one if that names no part.
        """
        if (quick := self.quick) is None:
            return self
        tasks = [
            task.model_copy(
                update={
                    "episodes": task.episodes and min(task.episodes, quick.episodes),
                    "bound_episodes": task.bound_episodes and min(task.bound_episodes, quick.bound_episodes),
                }
            )
            for task in sorted(self.tasks, key=lambda task: not in_order and task.title != quick.first)
        ]
        numbers = {name: min(getattr(self, name), getattr(quick, name)) for name in ("episodes", "bound_episodes")}
        return self.model_copy(update={**numbers, "tasks": tuple(tasks)})


def configure(
    config: str, changes: Mapping[str, Any], tasks: Sequence[str] | None = None, *, full: bool = True
) -> BenchmarkConfig:
    """A benchmark from a configuration.

    Args:
        config: name of a shipped one, or path of a YAML file.
        changes: settings to change; ``env_config`` and ``options`` are added to those of every task, and ``level`` is
            its level. ``policies`` are those of every task, without experts that other tasks alone have.
        tasks: titles of tasks of the configuration, to run these alone; the id of an environment stands for all of its
            tasks there where none has that title, and for the environment itself where there are none.
            A ``control_mode`` in ``env_config`` is that of every policy, also where the configuration has others.
        full: whether to run all of it, and not its quick part.

    Raises:
        ValueError: for an unknown configuration, task or setting.
    """
    if isinstance(tasks, str):
        raise ValueError(f"tasks {tasks!r} is one name: give a list, [{tasks!r}]")
    whole = load_config(config, BenchmarkConfig)
    if whole.quick and whole.quick.first:
        refuse_unknown([whole.quick.first], [task.title for task in whole.tasks], "task of quick.first")
    loaded = whole if full else whole.shortened(in_order=changes.get("policies") is not None)
    changes = dict(changes)
    chosen = list(loaded.tasks if tasks is None else _chosen(loaded, tasks))
    if (level := changes.pop("level", None)) is not None:
        chosen = _at_one_level(chosen, level, set(tasks or ()))
    for name in ("env_config", "options"):
        more = portable(changes.pop(name, {}))
        own_modes: dict[str, Any] = {"control_modes": {}} if "control_mode" in more else {}
        chosen = [task.changed(name, more).model_copy(update=own_modes) for task in chosen]
    policies = changes.get("policies")
    if policies is not None:
        own = [(task, _without_other_experts(policies, task.env)) for task in chosen]
        acting = [task.model_copy(update={"policies": names}) for task, names in own if names]
        chosen = acting or [task.model_copy(update={"policies": None}) for task in chosen]
    return BenchmarkConfig.parse({**dict(loaded), **changes, "tasks": tuple(chosen)}, "benchmark setting")


def _at_one_level(tasks: Sequence[BenchmarkTask], level: str, named: set[str]) -> list[BenchmarkTask]:
    """Each environment among some tasks at a level: its plain task; a ValueError for one of its own that is named."""
    found = dict[str, BenchmarkTask]()
    for task in tasks:
        own = task.level or task.name or task.env_config or task.options
        if own and task.title in named - {task.env}:
            raise ValueError(
                f"task {task.title!r} has settings of its own beside --level {level}; name {task.env} instead"
            )
        plain: dict[str, Any] = {
            "env": task.env,
            "policies": task.policies,
            "control_modes": task.control_modes,
            "level": level,
        }
        if not own:
            plain |= {"episodes": task.episodes, "bound_episodes": task.bound_episodes}
        found.setdefault(task.env, BenchmarkTask.parse(plain, "task"))
    return list(found.values())


def _chosen(config: BenchmarkConfig, names: Sequence[str]) -> list[BenchmarkTask]:
    """Tasks of a configuration by their titles, or all of an environment by its id; other environments by their ids."""
    titles = {task.title: task for task in config.tasks}
    chosen = list[BenchmarkTask]()
    for name in map(import_env, names):
        refuse_unknown([name], {*titles, *envs.env_ids()}, "task")
        found = [titles[name]] if name in titles else [task for task in config.tasks if task.env == name]
        chosen += found or [BenchmarkTask.parse({"env": name, "policies": tuple(expert_names(name))}, "task")]
    return chosen


def _without_other_experts(policies: Sequence[str], env_id: str) -> tuple[str, ...]:
    """The policies that are not experts of other tasks only."""
    here = expert_names(env_id)
    return tuple(name for name in policies if name.removesuffix(ADAPTIVE) in here or not is_expert(name))
