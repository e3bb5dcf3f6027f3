"""The table of training seeds of a shipped agent, from what `tools.release_agent` has written into the agent's JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

import envs
from agents.tables import Table, short_text


def training_seeds(document: Mapping[str, Any], caption: str = "") -> Table:
    """A row a training seed, the shipped one in bold, and their mean and spread.

    Args:
        document: the JSON of an agent that `tools.release_agent` has selected.
        caption: what stands below it.
    """
    titles = ("seconds", "best at step", "selection (%)", "its return", "held-out (%)", "return")
    metrics = (metric.title for metric in envs.task_card(document["env"]).metrics)
    shipped, rows, numbers = document["training"]["seed"], [], []
    for each in document["seeds"]:
        numbers.append(_numbers(document, each))
        name = f"**{each['seed']}**, shipped" if each["seed"] == shipped else str(each["seed"])
        rows.append((name, *map(short_text, numbers[-1])))
    over_seeds = [spread(column) for column in zip(*numbers, strict=True)]
    rows.append(("mean ± std", *(_with_deviation(column["mean"], column["std"]) for column in over_seeds)))
    for name, key in (("least", "min"), ("greatest", "max")):
        rows.append((name, *(short_text(column[key]) for column in over_seeds)))
    return Table("", ("training seed", *titles, *metrics, "within limits (%)"), rows, caption)


def meaning(document: Mapping[str, Any]) -> str:
    """What the numbers of the table are: the same for all agents that were scored on as many episodes."""
    rule, held_out = document["selection"]["rule"], document["held_out"]
    first, last = held_out["seeds"]
    return (
        f"Shipped: {rule[0].lower()}{rule[1:]} Held-out: seeds {first} to {last}, which selected nothing. Return: "
        f"mean; all else: medians. Within limits: no value above {held_out['limit_ratio_kept']} of its limit. "
        "Seconds: of training, without evaluations."
    )


def result(document: Mapping[str, Any]) -> str:
    """How often the shipped agent succeeds."""
    value, low, high = (100.0 * document["held_out"]["success"][name] for name in ("value", "low", "high"))
    return f"On held-out seeds the shipped agent succeeds in {value:.1f} % (95 % interval {low:.1f} to {high:.1f})."


def spread(values: Sequence[float]) -> dict[str, float]:
    """Mean, standard deviation (of the population that the seeds are drawn from; NaN for one seed) and extremes."""
    array = np.array(values)
    several = len(array) > 1 and bool(np.isfinite(array).all())
    deviation = float(array.std(ddof=1)) if several else np.nan
    return {"mean": float(array.mean()), "std": deviation, "min": float(array.min()), "max": float(array.max())}


def _numbers(document: Mapping[str, Any], seed: Mapping[str, Any]) -> list[float]:
    """The numbers of a training seed, in the units of the table."""
    factors = {metric.key: metric.factor for metric in envs.task_card(document["env"]).metrics}
    numbers = [round(seed["seconds"]), seed["best_steps"]]
    held_out = ("success", "return", *factors, "limits_kept")
    for scores, names in ((seed["selection"], ("success", "return")), (seed["held_out"], held_out)):
        for name in names:
            is_share = isinstance(document["held_out"][name], Mapping)
            value = math.inf if scores[name] is None else scores[name]  # never, in JSON
            numbers.append((100.0 if is_share else factors.get(name, 1.0)) * value)
    return numbers


def _with_deviation(mean: float, deviation: float) -> str:
    shown = short_text(mean)
    return shown if np.isnan(deviation) else f"{shown} ± {deviation:{',.0f' if deviation >= 100.0 else '.2g'}}"
