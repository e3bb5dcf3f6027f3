"""Replays: episodes of a benchmark, recorded at a reduced rate for pages that play them again."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from typing import Any

from agents.environments import make_one, task_type
from agents.evaluation.benchmark_config import BenchmarkTask
from agents.evaluation.compare import worst_first
from agents.evaluation.leaderboard import TaskResult
from agents.policies.lookup import NamedPolicy
from agents.policies.play import Info, play
from envs.rendering.document import scene_document
from envs.task import Task

FRAME_RATE = 20.0
"""Frames a second of a replay, where that gives as many frames as `FRAMES` allows."""
FRAMES = (75, 150)
"""Least and largest number of frames of an episode as long as its horizon, if it has so many control periods."""
_SHARES = ("torque_ratios", "limit_gauges", "bucket")  # fields of a scene, recorded in percent


def seeds_to_record(result: TaskResult, count: int) -> list[int]:
    """Which seeds of a task are recorded, ``count`` of them if there are so many, in ascending order.

    The first half are the first seeds. The others are the worst episodes (by success, then by the primary metric) of
    each policy in turn, in the order of the leaderboard, then the second worst, and so on.
    """
    chosen = dict.fromkeys(result.seeds[: math.ceil(count / 2)].tolist())
    ranked = [worst_first(evaluation, result.card.primary) for evaluation in result.ranked]
    for place in range(len(result.seeds)):
        for order in ranked:
            if len(chosen) < count:
                chosen[int(result.seeds[order[place]])] = None
    return sorted(chosen)


Recorder = Callable[[Sequence[int]], list[dict[str, Any]]]  # the replays of every policy on some seeds, by policy


def record_replays(result: TaskResult, count: int, record: Recorder) -> dict[str, Any] | None:
    """Replays of every policy on some seeds of a task, as a document; None for an environment that has no scenes.

    Each episode is run again, in a single environment, so that neither scores nor timings depend on the recording.

    Args:
        result: the scores of the task.
        count: number of seeds.
        record: gives the replays of all policies on these seeds, as `replays_of` each of one.
    """
    if not count or task_type(result.task.env) is None:
        return None
    seeds = seeds_to_record(result, count)
    with closing(make_one(result.task.env, result.task.env_config)) as env:
        view = env.unwrapped.task.view  # type: ignore[attr-defined]
    return {"view": view, "seeds": seeds, "units": units_of(view), "episodes": record(seeds)}


def replays_of(
    task: BenchmarkTask, named: NamedPolicy, seeds: Sequence[int], progress: Callable[[int], object]
) -> list[dict[str, Any]]:
    """The episodes of a policy on some seeds of a task; ``progress`` is called with 1 after each."""
    episodes = []
    with closing(make_one(task.env, named.settings(task.env_config))) as env:
        for seed in seeds:
            episodes.append(
                {"policy": named.name, "seed": seed, **record_replay(env, named.policy, seed, task.options)}
            )
            progress(1)
    return episodes


def record_replay(env: Any, policy: Any, seed: int, options: Info) -> dict[str, Any]:
    """One episode of a policy in a single environment, as a document.

    ``fixed`` is the scene document (`envs.rendering.document`) with what does not change, ``numbers`` are the other
    numbers by their path in it, such as ``joints.2.0``: multiplied by their unit (`units_of`) and rounded, the first
    frame's and then the differences from frame to frame, separated by spaces ("-" if there is none). ``texts`` are
    lines of text. Gauges hold the largest value since the frame before.
    """
    task: Task = env.unwrapped.task
    units, every = units_of(task.view), 1
    frames: list[dict[str, Any]] = []

    def observe(steps: int, ended: bool) -> None:
        nonlocal every
        if steps % every and not ended:
            return
        scene = task.scene(0, ())
        if steps == 0:
            every = _stride(scene.horizon, task.config.control_period)
        frames.append(dict(_leaves({**scene_document(scene), "trail": None})))
        task.forget_worst_ratios(0)

    info = play(env, policy, seed, dict(options), observe)
    paths = list(dict.fromkeys(path for frame in frames for path in frame))
    columns = {path: [frame.get(path) for frame in frames] for path in paths}
    moving = {path: values for path, values in columns.items() if any(value != values[0] for value in values)}
    numbers = {
        path: _differences(values, units.get(path.split(".")[0], units[""]))
        for path, values in moving.items()
        if not any(isinstance(value, str) for value in values)
    }
    return {
        "return": info["return"],
        "length": info["length"],
        "frames": len(frames),
        "fixed": {path: values[0] for path, values in columns.items() if path not in moving},
        "numbers": numbers,
        "texts": {path: _lines(values) for path, values in moving.items() if path not in numbers},
    }


def units_of(view: Sequence[float]) -> dict[str, int]:
    """By which the numbers of a field of a scene are multiplied; "" for those of all other fields, which are lengths.

    Positions are recorded to 1 mm, and finer where the visible part of the plane is small.
    """
    span = max(view[1] - view[0], view[3] - view[2])
    finer: int = 10 ** math.ceil(math.log10(1.5 / span))
    return {"": 1000 * max(1, finer), "time": 1000, **dict.fromkeys(_SHARES, 100)}


def _stride(seconds: float, period: float) -> int:
    """Control periods from one frame to the next in an episode of so many seconds."""
    wanted, periods, (least, largest) = round(1.0 / (FRAME_RATE * period)), seconds / period, FRAMES
    return max(1, min(wanted, int(periods / least)), math.ceil(periods / (largest - 1) - 1e-6))


def _leaves(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """The values in nested mappings and lists, by the keys and places that lead to them; an empty list is a value."""
    items: Any = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    if not items or value == []:
        yield path, value
    for key, item in items:
        yield from _leaves(item, f"{path}.{key}" if path else str(key))


def _differences(values: Sequence[Any], scale: int) -> str:
    """Numbers as text: the first, then the differences; "-" where there is none."""
    last, texts = 0, []
    for value in values:
        if value is None:
            texts.append("-")
            continue
        number = round(scale * float(value))
        texts.append(str(number - last))
        last = number
    return " ".join(texts)


def _lines(values: Sequence[Any]) -> str:
    return "\n".join("" if value is None else str(value).replace("\n", " ") for value in values)
