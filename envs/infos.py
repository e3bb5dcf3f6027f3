"""Infos of a task: flat, with the same keys at a reset and at every step."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from envs.physics.actuation import LIMIT_KINDS

if TYPE_CHECKING:
    from envs.task import Task

Info = dict[str, Any]


class TaskInfos:
    """Writes the infos of a task's environments, one by one or in Gymnasium's vector form.

    The keys are ``is_success``, ``reward_<term>``, the task's outcomes, ``limit_ratio`` (the worst of all kinds) and
    ``limit_ratios`` (in the order of `LIMIT_KINDS`). What is not known is NaN, or False where it is a bool: reward
    terms at a reset, outcomes and limits before the end of an episode.
    """

    def __init__(self, task: Task) -> None:
        self._task, self._records = task, task.batch
        self._terms = [f"reward_{name}" for name in task.reward_terms]
        bools = ["is_success", *(name for name in task.outcomes if name in task.boolean_outcomes)]
        numbers = [*self._terms, *(name for name in task.outcomes if name not in bools), "limit_ratio"]
        keys = ["is_success", *self._terms, *task.outcomes, "limit_ratio", "limit_ratios"]
        self._unknown_ratios = np.full(len(LIMIT_KINDS), math.nan)
        self._unknown: Info = {key: key not in bools and math.nan for key in keys}
        self._bools, self._numbers, self._masks = bools, numbers, [f"_{key}" for key in keys]

    def at_reset(self) -> Info:
        """Info of one environment at the start of an episode."""
        return {**self._unknown, "limit_ratios": self._unknown_ratios.copy()}

    def at_step(self, env_index: int, *, ended: bool) -> Info:
        """Info of one environment after a step, which has ended the episode or not."""
        record, info = self._records[env_index], self._unknown.copy()
        info["is_success"] = bool(record["success"])
        info.update(zip(self._terms, record["reward_terms"].tolist(), strict=True))
        if ended:
            info.update(self._outcome(env_index))
            info["limit_ratios"] = record["limit_ratios"].copy()
            info["limit_ratio"] = float(info["limit_ratios"].max())
        else:
            info["limit_ratios"] = self._unknown_ratios.copy()
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
        batch, n = self._records, len(self._records)
        numbers = np.full((len(self._numbers), n), math.nan)
        bools = np.zeros((len(self._bools), n), dtype=np.bool_)
        ratios = np.full((n, len(LIMIT_KINDS)), math.nan)
        numbers[: len(self._terms)] = batch["reward_terms"].T
        bools[0] = batch["success"]
        if begun is not None:
            numbers[: len(self._terms), begun] = math.nan
            bools[0, begun] = False
        infos: Info = {**_by_name(self._bools, bools), **_by_name(self._numbers, numbers), "limit_ratios": ratios}
        if ended is not None:
            ratios[ended] = batch["limit_ratios"][ended]
            infos["limit_ratio"][ended] = ratios[ended].max(axis=1)
            for env_index in np.flatnonzero(ended).tolist():
                for key, value in self._outcome(env_index).items():
                    infos[key][env_index] = value
        masks = np.ones((len(self._masks), n), dtype=np.bool_)
        if present is not None:
            absent = ~present
            numbers[:, absent], bools[:, absent], ratios[absent], masks[:, absent] = 0.0, False, 0.0, False
        infos.update(_by_name(self._masks, masks))
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
        for key, value in outcome.items():
            if isinstance(value, (bool, np.bool_)) != (key in task.boolean_outcomes):
                raise ValueError(
                    f"{type(task).__name__}.outcome gives {key} = {value!r}: name what is a bool, and nothing else, in "
                    f"{type(task).__name__}.boolean_outcomes"
                )
        return {key: value if key in task.boolean_outcomes else float(value) for key, value in outcome.items()}


def _by_name(names: list[str], rows: NDArray[Any]) -> Info:
    """Rows of an array by name."""
    return dict(zip(names, rows, strict=True))
