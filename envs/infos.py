"""Infos of a task: flat, with the same keys at a reset and at every step."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from envs.physics.actuation import LIMIT_KINDS

if TYPE_CHECKING:
    from envs.task import Task

Info = dict[str, Any]


class Unknown(np.float64):
    """NaN that equals itself: Gymnasium compares the infos of two equal episodes by ``==``."""

    def __new__(cls) -> Unknown:
        """The one value that there is."""
        return super().__new__(cls, math.nan)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Unknown)

    def __ne__(self, other: object) -> bool:
        return not isinstance(other, Unknown)

    def __hash__(self) -> int:
        return hash(Unknown)

    def __repr__(self) -> str:
        return "nan"

    def __reduce__(self) -> tuple[type[Unknown], tuple[()]]:
        return Unknown, ()


class TaskInfos:
    """Writes the infos of a task's environments, one by one or in Gymnasium's vector form.

    The keys are ``is_success``, ``reward_<term>``, the task's outcomes, ``limit_ratio`` (the worst of all kinds so far)
    and ``limit_ratios`` (the worst so far of each, in the order of `LIMIT_KINDS`). What is not known is NaN, or False
    where it is a bool: reward terms at a reset, outcomes before the end of an episode. Without the setting `info_terms`
    there are infos of the ends of episodes only; the others are empty.
    """

    def __init__(self, task: Task) -> None:
        self._task, self._records = task, task.batch
        self._ratios = self._records["limit_ratios"]
        self._own_ratios = self._ratios[0]
        self._terms = [f"reward_{name}" for name in task.reward_terms]
        self._each_step, self._wanted = ["is_success", *self._terms], bool(task.config.info_terms)
        bools = ["is_success", *(name for name in task.outcomes if name in task.boolean_outcomes)]
        numbers = [*self._terms, *(name for name in task.outcomes if name not in bools), "limit_ratio"]
        keys = ["is_success", *self._terms, *task.outcomes, "limit_ratio", "limit_ratios"]
        unknown = Unknown()
        self._unknown: Info = {key: False if key in bools else unknown for key in keys}
        self._everyone = np.ones(len(self._records), dtype=np.bool_)
        self._bools, self._numbers, self._masks = bools, numbers, [f"_{key}" for key in keys]

    def at_reset(self) -> Info:
        """Info of one environment at the start of an episode."""
        if not self._wanted:
            return {}
        return {**self._unknown, "limit_ratio": 0.0, "limit_ratios": np.zeros(len(LIMIT_KINDS))}

    def at_step(self, worst: float, known: Iterable[Any], *, ended: bool) -> Info:
        """Info of a single environment after a step.

        Args:
            worst: the largest of the limit ratios.
            known: whether the task is solved, and the terms of the reward.
            ended: whether the step has ended the episode.
        """
        if not (ended or self._wanted):
            return {}
        info = self._unknown.copy()
        info.update(zip(self._each_step, known, strict=True))
        info["limit_ratio"] = worst
        info["limit_ratios"] = self._own_ratios.copy()
        if ended:
            info.update(self._outcome(0))
        return info

    def of_batch(
        self,
        *,
        present: NDArray[np.bool_] | None = None,
        begun: NDArray[np.bool_] | None = None,
        ended: NDArray[np.bool_] | None = None,
    ) -> Info:
        """Infos in Gymnasium's vector form: an array and a mask a key.

        Args:
            present: which environments have an info, ``(num_envs,)``; the others' values are 0; all if left out.
            begun: which have just been reset; none if left out.
            ended: of which the step has ended the episode; none if left out.
        """
        if ended is None and not self._wanted:
            return {}
        n, terms = len(self._records), len(self._terms)
        rows: Any = slice(None) if present is None else np.flatnonzero(present)
        numbers, bools = np.zeros((len(self._numbers), n)), np.zeros((len(self._bools), n), dtype=np.bool_)
        numbers[terms:, rows] = math.nan
        numbers[:terms, rows] = self._records["reward_terms"][rows].T
        numbers[-1, rows] = self._records["limit_ratio"][rows]
        bools[0, rows] = self._records["success"][rows]
        ratios = np.zeros(self._ratios.shape)
        ratios[rows] = self._ratios[rows]
        if begun is not None:
            unknown = begun if present is None else begun & present
            numbers[:terms, unknown] = math.nan
            bools[0, unknown] = False
        infos: Info = dict(zip([*self._bools, *self._numbers], [*bools, *numbers], strict=True))
        infos["limit_ratios"] = ratios
        if ended is not None:
            for env_index in np.flatnonzero(ended).tolist():
                for key, value in self._outcome(env_index).items():
                    infos[key][env_index] = value
        infos.update(dict.fromkeys(self._masks, (self._everyone if present is None else present).copy()))
        return infos

    def _outcome(self, env_index: int) -> Info:
        """The task's own results of an episode.

        Raises:
            ValueError: if their keys or kinds are not those that the task declares.
        """
        outcome, task = self._task.outcome(self._records[env_index]), self._task
        if outcome.keys() != task.outcomes.keys():
            raise ValueError(
                f"{type(task).__name__}.outcome gives {sorted(outcome)}, and {type(task).__name__}.outcomes describes "
                f"{sorted(task.outcomes)}: make the keys the same"
            )
        known: Info = {}
        for key, value in outcome.items():
            boolean = isinstance(value, (bool, np.bool_))
            if boolean != (key in task.boolean_outcomes):
                raise ValueError(
                    f"{type(task).__name__}.outcome gives {key} = {value!r}: name what is a bool, and nothing else, in "
                    f"{type(task).__name__}.boolean_outcomes"
                )
            known[key] = value if boolean else float(value)
        return known
