"""The results of several files side by side: policies on the same episodes of a task are put together."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Collection, Sequence

import numpy as np

from agents.evaluation import statistics
from agents.report.results_file import Replays, Results, TaskScores, ranked


def side_by_side(files: Sequence[tuple[str, Results]]) -> list[TaskScores]:
    """The tasks of several files, each given with its name; the policies of a task are best first.

    Policies are put together where title, settings, options and seeds of the task are the same. One that has the name
    of another gets that of its file too. Policies that were compared in pairs are compared with those of the other
    files. Tasks that share a title only have the names of their files behind it.
    """
    together: dict[str, list[tuple[str, TaskScores]]] = {}
    for name, results in files:
        for task in results.results:
            same = json.dumps([task.task, task.env, task.env_config, task.options, task.seeds], sort_keys=True)
            together.setdefault(same, []).append((name, task))
    titles = Counter(parts[0][1].task for parts in together.values())
    tasks = []
    for parts in together.values():
        task = _merged(parts)
        if titles[task.task] > 1:
            names = dict.fromkeys(name for name, _ in parts)
            task = task.model_copy(update={"task": f"{task.task} ({', '.join(names)})"})
        tasks.append(task)
    return tasks


def _merged(parts: Sequence[tuple[str, TaskScores]]) -> TaskScores:
    merged = parts[0][1]
    for name, part in parts[1:]:
        taken = {each.policy for each in merged.policies}
        new = {each.policy: _free_name(each.policy, name, taken) for each in part.policies}
        policies = [
            each.model_copy(update={"policy": new[each.policy], "original": each.policy}) for each in part.policies
        ]
        pairs = [pair.model_copy(update={"policy": new.get(pair.policy, "")}) for pair in part.pairs]
        merged = merged.model_copy(
            update={
                "policies": [*merged.policies, *policies],
                "pairs": [*merged.pairs, *pairs],
                "bound": merged.bound or part.bound,
                "lower_bound": merged.lower_bound if merged.bound else part.lower_bound,
                "bound_meaning": merged.bound_meaning or part.bound_meaning,
                "published": merged.published or part.published,
                "metrics": merged.metrics or part.metrics,
                "replays": _together(merged.replays, part.replays, new),
            }
        )
    merged = _best_bounded(merged, [part for _, part in parts])
    return merged.model_copy(update={"policies": ranked(merged.policies)})


def _best_bounded(merged: TaskScores, parts: Sequence[TaskScores]) -> TaskScores:
    """A task with the best of the best known values of several files, which are no worse than the file's policies."""
    known = [part.bounds for part in parts if part.bounds is not None]
    if len(known) < 2:
        return merged
    metric = known[0][0]
    better = min if metric.lower_is_better else max
    of_episodes = [
        [bounds[seed] for _, bounds in known if np.isfinite(bounds.get(seed, np.inf))] for seed in known[0][1]
    ]
    best = np.array([better(each) if each else np.inf for each in of_episodes])
    reachable = np.isfinite(best)
    policies = []
    for policy in merged.policies:
        values = np.nan_to_num(policy.evaluation.metrics[metric.key], nan=np.inf)  # null is never
        above = values[: len(best)][reachable] - best[reachable]
        if above.size:
            ends = {name: end if math.isfinite(end) else None for name, end in vars(statistics.median(above)).items()}
            median = policy.summary["success"].model_copy(update=ends)
            policy = policy.model_copy(update={"summary": {**policy.summary, "above_bound": median}})
        policies.append(policy)
    bound = {metric.key: [value if math.isfinite(value) else None for value in best.tolist()]}
    return merged.model_copy(update={"policies": policies, "bound": bound})


def _together(ours: Replays | None, theirs: Replays | None, names: dict[str, str]) -> Replays | None:
    """Replays of two files; those of the second get the new names of its policies."""
    if theirs is None:
        return ours
    renamed = [each.model_copy(update={"policy": names.get(each.policy, "")}) for each in theirs.episodes]
    if ours is None:
        return theirs.model_copy(update={"episodes": renamed})
    if (ours.view, ours.units) != (theirs.view, theirs.units):
        return ours
    return ours.model_copy(
        update={"seeds": sorted({*ours.seeds, *theirs.seeds}), "episodes": [*ours.episodes, *renamed]}
    )


def _free_name(policy: str, file: str, taken: Collection[str]) -> str:
    name, number = policy, 1
    while name in taken:
        name, number = f"{policy} ({file})" if number == 1 else f"{policy} ({file} {number})", number + 1
    return name
