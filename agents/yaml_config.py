"""Experiments as YAML: found by name among the shipped ones or by path, validated, typos refused."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any, Self, TypeVar

import yaml
from pydantic import Field

from envs.settings import Settings, refuse_unknown

SettingsType = TypeVar("SettingsType", bound=Settings)


class Published(Settings):
    """A figure from a paper, to stand beside ours.

    Attributes:
        source: where it was published.
        settling_time: s.
        note: what to bear in mind when comparing.
    """

    source: str
    settling_time: float = Field(gt=0.0)
    note: str = ""


class BenchmarkTask(Settings):
    """One task of a benchmark.

    Attributes:
        env: id of the environment.
        name: how the leaderboard calls it; the id when left out.
        env_config: settings of the environment.
        options: of each reset.
        policies: who takes part, if not those of the benchmark.
        episodes: how many, if not as many as the benchmark's other tasks.
        bound_episodes: for how many of them the bound is computed, if not for as many as elsewhere.
        published: a figure from a paper, for its own row.
    """

    env: str
    name: str = ""
    env_config: dict[str, Any] = Field(default_factory=dict)
    options: dict[str, Any] = Field(default_factory=dict)
    policies: tuple[str, ...] | None = Field(None, min_length=1)
    episodes: int | None = Field(None, ge=1)
    bound_episodes: int | None = Field(None, ge=0)
    published: Published | None = None

    @classmethod
    def parse(cls, given: Mapping[str, Any], what: str) -> Self:
        """As `Settings.parse`; mistyped names within ``published`` too."""
        published = given.get("published")
        if isinstance(published, dict):
            given = {**given, "published": Published.parse(published, "setting of a published figure")}
        return super().parse(given, what)

    @property
    def title(self) -> str:
        """How the leaderboard calls it."""
        return self.name or self.env


class BenchmarkConfig(Settings):
    """A benchmark: every policy on every task, on the same seeds.

    Attributes:
        episodes: of each policy on each task.
        bound_episodes: for how many of them the bound is computed.
        seed: of the first episode; the next has the next.
        num_envs: episodes that run at once.
        policies: names of experts, ``agent`` for the agent shipped for the environment, paths of runs and
            agents.
        tasks: what they do.
    """

    episodes: int = Field(ge=1)
    bound_episodes: int = Field(ge=0)
    seed: int = Field(0, ge=0)
    num_envs: int = Field(256, ge=1)
    policies: tuple[str, ...] = Field(min_length=1)
    tasks: tuple[BenchmarkTask, ...] = Field(min_length=1)

    @classmethod
    def parse(cls, given: Mapping[str, Any], what: str) -> Self:
        """As `Settings.parse`; a mistyped name within a task is answered with the nearest known one too."""
        tasks = given.get("tasks")
        if isinstance(tasks, (list, tuple)):
            parsed = [BenchmarkTask.parse(task, "task setting") if isinstance(task, dict) else task for task in tasks]
            given = {**given, "tasks": parsed}
        return super().parse(given, what)


def load_experiment(source: str, settings: type[SettingsType]) -> SettingsType:
    """Settings from YAML.

    Args:
        source: a path that ends in .yaml or .yml, or the name of a shipped experiment.
        settings: what the file must hold.

    Raises:
        ValueError: if there is no such file, it is no YAML, or a name or value in it is not known.
    """
    text = _read(source)
    try:
        content = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise ValueError(f"{source} is no YAML: {' '.join(str(error).split())}") from None
    if not isinstance(content, dict):
        raise ValueError(f"{source} must hold names and values, not {content!r}")
    return settings.parse(content, f"{source} setting")


def assigned(settings: Mapping[str, Any], changes: Iterable[str]) -> dict[str, Any]:
    """Settings with some changed.

    Args:
        settings: by name.
        changes: ``key=value``; dots lead into nested settings, values are YAML.

    Raises:
        ValueError: for what is no such assignment.
    """
    answer = dict(settings)
    for change in changes:
        key, equals, text = change.partition("=")
        if not equals or not key:
            raise ValueError(f'"{change}" is no key=value, such as gamma=0.99 or warm_start.episodes=512')
        try:
            value = yaml.safe_load(text)
        except yaml.YAMLError:
            raise ValueError(f'"{change}": {text!r} is no YAML value') from None
        _assign(answer, key.split("."), value)
    return answer


def _assign(settings: dict[str, Any], path: list[str], value: Any) -> None:
    """Set a nested value; levels that are missing are made, and refused later if they are not known."""
    for name in path[:-1]:
        inner = settings.get(name)
        settings[name] = dict(inner) if isinstance(inner, Mapping) else {}
        settings = settings[name]
    settings[path[-1]] = value


def shipped_experiments() -> list[str]:
    """Names of the experiments that come with planarm, those in folders as ``ppo/ConveyorTrack-v0``."""
    return sorted(_names(resources.files("configs")))


def _names(folder: Traversable, prefix: str = "") -> Iterator[str]:
    for item in folder.iterdir():
        if item.is_dir():
            yield from _names(item, f"{prefix}{item.name}/")
        elif item.name.endswith(".yaml"):
            yield prefix + item.name.removesuffix(".yaml")


def _read(source: str) -> str:
    if source.endswith((".yaml", ".yml")):
        try:
            return Path(source).read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise ValueError(f"cannot read {source}: {error}") from None
    refuse_unknown([source], shipped_experiments(), "experiment (a file's name ends in .yaml)")
    folder, _, name = f"{source}.yaml".rpartition("/")
    files = resources.files("configs")
    return ((files / folder if folder else files) / name).read_text(encoding="utf-8")
