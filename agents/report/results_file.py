"""The results that `planarm benchmark --json` writes, read back and checked."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from agents.environments import card_of
from agents.evaluation.results import Evaluation, Timing
from agents.evaluation.statistics import Estimate
from envs.card import Metric
from planners.files import json_text

MOST_BYTES = 1 << 28
"""Largest size of a file of results, bytes."""
MOST_NUMBER = 1e30
"""Largest size of a number in it."""
_EPISODE = ("seed", "return", "length", "is_success")  # columns that the episodes of every policy have


class _Oversized(ValueError):
    """A number in a file that no result is."""


def _number(text: str) -> float:
    """A number of JSON; `_Oversized` for one that is not finite, or so large that charts could not hold it."""
    value = float(text)
    if not abs(value) <= MOST_NUMBER:
        raise _Oversized(f"the number {text:.40}")
    return int(text) if text.lstrip("-").isdigit() else value


class _Part(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True)


class _Estimate(_Part):
    """An estimate; null in place of what is infinite or not known."""

    value: float | None
    low: float | None
    high: float | None

    @property
    def numbers(self) -> Estimate:
        """With NaN in place of what is not known, and inf of what is infinite as the other numbers show."""
        value, low, high = (np.nan if end is None else end for end in (self.value, self.low, self.high))
        if self.low is not None and self.high is None:
            high, value = np.inf, np.inf if self.value is None else value
        elif self.high is not None and self.low is None:
            low, value = -np.inf, -np.inf if self.value is None else value
        return Estimate(value, low, high)


class _Timing(_Part):
    env_steps: int = Field(ge=1)
    plans: int = Field(0, ge=0)
    planning_seconds: float = Field(ge=0.0)
    policy_seconds: float
    env_seconds: float = Field(ge=0.0)
    infeasible: int = 0


class PolicyScores(_Part):
    """The scores of a policy on a task."""

    policy: str
    original: str | None = None  # its name in its file, if a report gives it another
    source: str | None = None
    action_config: dict[str, Any] = {}
    summary: dict[str, _Estimate]
    timing: _Timing
    episodes: dict[str, list[bool | int | float | None]]

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if problem := _problem(self.episodes):
            raise ValueError(f"episodes of {self.policy}: {problem}")
        if missing := {"success", "return"} - self.summary.keys():
            raise ValueError(f"summary of {self.policy}: expected {' and '.join(sorted(missing))}")
        return self

    @property
    def seeds(self) -> list[int]:
        """One an episode."""
        return [int(seed or 0) for seed in self.episodes["seed"]]

    def estimate(self, key: str) -> Estimate | None:
        """A number of the summary by its key; NaN in place of what is not known.

        A median is infinite where more than half of the episodes have no number: a time that is never.
        """
        if key not in self.summary:
            return None
        found, column = self.summary[key].numbers, self.episodes.get(key, [])
        if np.isnan([found.value, found.low, found.high]).all() and 2 * column.count(None) > len(column):
            return Estimate(np.inf, np.inf, np.inf)
        return found

    @property
    def evaluation(self) -> Evaluation:
        """The episodes as they were evaluated."""
        columns = {key: np.array(column, dtype=float) for key, column in self.episodes.items()}
        return Evaluation(
            policy=self.policy,
            env_id="",
            seeds=np.array(self.seeds),
            returns=columns["return"],
            lengths=columns["length"].astype(np.int64),
            metrics={key: column for key, column in columns.items() if key not in _EPISODE[:3]},
            timing=Timing(**self.timing.model_dump()),
        )

    @property
    def action_us(self) -> float:
        """Time of an action, with planning, microseconds."""
        return 1e6 * (self.timing.planning_seconds + self.timing.policy_seconds) / self.timing.env_steps


def _is_whole(value: bool | float | None) -> bool:
    return value is not None and not isinstance(value, bool) and 0 <= value < 2**63 and value % 1 == 0


def _problem(columns: Mapping[str, Sequence[bool | float | None]]) -> str | None:
    """What is wrong with the columns of episodes; None if nothing is."""
    if not columns.keys() >= set(_EPISODE) or len(set(map(len, columns.values()))) != 1 or not columns["seed"]:
        return f"expected columns of one length, {', '.join(_EPISODE)} and more"
    for name, meaning in (("seed", "seeds"), ("length", "lengths")):
        if not all(_is_whole(each) for each in columns[name]):
            return f"{meaning} are whole numbers from 0 to below 2^63"
    if len(set(columns["seed"])) < len(columns["seed"]):
        return "two have the same seed"
    if any(each not in (0.0, 1.0) for each in columns["is_success"]):
        return "is_success is true or false"
    return None


class _Pair(_Part):
    policy: str
    against: str


class _Metric(_Part):
    key: str
    title: str
    factor: float = 1.0
    primary: bool = False
    lower_is_better: bool = True


class _Replay(_Part):
    policy: str
    seed: int
    returned: float | None = Field(alias="return")
    length: int
    frames: int = Field(ge=1, le=100_000)
    fixed: dict[str, Any]
    numbers: dict[str, str]
    texts: dict[str, str]


class Replays(_Part):
    """Recorded episodes of a task, as `agents.evaluation.replays` makes them."""

    view: tuple[float, float, float, float]
    seeds: list[int]
    units: dict[str, float]
    episodes: list[_Replay]


class TaskScores(_Part):
    """The scores of all policies on a task."""

    task: str
    env: str
    env_name: str | None = None
    env_config: dict[str, Any] = {}
    options: dict[str, Any] = {}
    policies: list[PolicyScores] = Field(min_length=1)
    bound: dict[str, list[float | None]] | None = None
    lower_bound: dict[str, list[float | None] | None] | None = None
    bound_meaning: str | None = None
    published: dict[str, Any] | None = None
    pairs: list[_Pair] = []
    metrics: list[_Metric] | None = None
    replays: Replays | None = None

    @model_validator(mode="after")
    def _paired(self) -> Self:
        if any(each.seeds != self.seeds for each in self.policies):
            raise ValueError(f"the policies of {self.task} have different seeds")
        if len({each.policy for each in self.policies}) < len(self.policies):
            raise ValueError(f"two policies of {self.task} have the same name")
        for metric in self.columns:
            if metric.primary and any(metric.key not in each.episodes for each in self.policies):
                raise ValueError(f"a policy of {self.task} has no {metric.key} of its episodes")
        return self

    @property
    def compared(self) -> set[str]:
        """Policies that are compared with each of the others; the best one where the file compares none."""
        return {pair.policy for pair in self.pairs} or {ranked(self.policies)[0].policy}

    @property
    def seeds(self) -> list[int]:
        """One an episode, those of every policy."""
        return self.policies[0].seeds

    @property
    def columns(self) -> tuple[Metric, ...]:
        """The metrics of its tables; of older files, those on the card of the task."""
        if self.metrics is None:
            return card_of(self.env).metrics
        return tuple(Metric(**metric.model_dump()) for metric in self.metrics)

    @property
    def primary(self) -> Metric | None:
        """The metric by which episodes are compared."""
        return next((metric for metric in self.columns if metric.primary), None)

    @property
    def bounds(self) -> tuple[Metric, dict[int, float]] | None:
        """The bounded metric and its best known value by seed, inf where none is known."""
        if self.bounded is None:
            return None
        metric, values = self.bounded
        return metric, dict(zip(self.seeds, (np.inf if value is None else value for value in values), strict=False))

    @property
    def certified(self) -> list[float]:
        """The lower bounds of the bounded metric by episode; empty unless all are known."""
        found = None if self.bounded is None else (self.lower_bound or {}).get(self.bounded[0].key)
        known = [value for value in found or [] if value is not None]
        return known if len(known) == len(found or []) else []

    @property
    def bounded(self) -> tuple[Metric, list[float | None]] | None:
        """The bounded metric and its best known values as they are in the file; None without any."""
        given = self.bound or {}
        return next(((each, given[each.key]) for each in self.columns if given.get(each.key)), None)

    @property
    def bound_name(self) -> str:
        """What the best known values are called, with their number if only the first episodes have one."""
        return f"best known{self.which_bounded}"

    @property
    def which_bounded(self) -> str:
        """Which episodes have a best known value, for names; empty for all."""
        count = len(self.bounds[1]) if self.bounds is not None else len(self.seeds)
        return "" if count == len(self.seeds) else f" (first {count})"


def ranked(policies: Sequence[PolicyScores]) -> list[PolicyScores]:
    """Best first: by success, then by return."""

    def rank(scores: PolicyScores) -> tuple[float, ...]:
        estimates = scores.estimate("success"), scores.estimate("return")
        return tuple(np.inf if each is None or np.isnan(each.value) else -each.value for each in estimates)

    return sorted(policies, key=rank)


class Results(_Part):
    """One file of results."""

    command: str = ""
    started: str = ""
    complete: bool = True
    versions: dict[str, str] = {}
    machine: dict[str, Any] = {}
    config: dict[str, Any] = {}
    results: list[TaskScores] = Field(min_length=1)

    @classmethod
    def of(cls, document: Mapping[str, Any]) -> Self:
        """The results in a document as it goes into a file."""
        tasks = [task for task in document["results"] if task["policies"]]
        return cls.model_validate(json.loads(json_text({**document, "results": tasks})))

    @classmethod
    def read(cls, path: Path) -> Self:
        """The results in a file.

        Raises:
            ValueError: if there is none, or the file holds something else.
        """
        if not os.path.isfile(path):
            reason = "it is no file" if os.path.exists(path) else "no such file"
            raise ValueError(f"cannot read {path}: {reason}")
        if path.stat().st_size > MOST_BYTES:
            raise ValueError(f"cannot read {path}: it is larger than {MOST_BYTES >> 20} MiB")
        expected = "expected what planarm benchmark --json writes"
        try:
            content = json.loads(path.read_bytes(), parse_float=_number, parse_int=_number, parse_constant=_number)
            json.dumps(content, ensure_ascii=False).encode()  # half of a pair of surrogates is no character
        except OSError as error:
            raise ValueError(f"cannot read {path}: {error.strerror}") from None
        except _Oversized as error:
            raise ValueError(f"cannot read {path}: it holds {error}, which is no result; {expected}") from None
        except (ValueError, RecursionError):
            raise ValueError(f"cannot read {path}: it is no JSON; {expected}") from None
        if not isinstance(content, dict) or not isinstance(content.get("results"), list):
            raise ValueError(f"cannot read {path}: it has no results; {expected}")
        try:
            tasks = [task for task in content["results"] if not isinstance(task, dict) or task.get("policies") != []]
            return cls.model_validate({**content, "results": tasks})
        except ValidationError as error:
            first = error.errors(include_url=False, include_input=False)[0]
            place = ".".join(map(str, first["loc"]))
            raise ValueError(f"cannot read {path}: {place}: {first['msg']}; {expected}") from None
