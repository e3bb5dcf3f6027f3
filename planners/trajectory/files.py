"""Trajectories as files: CSV for other programs, NPZ to load again."""

from __future__ import annotations

import errno
import json
import math
import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from planners.documents import parse_json, read_arrays
from planners.files import whole_file
from planners.problem import FixedHand, FixedJoints, MotionProblem, MovingHand, Obstacle, Target
from planners.robot.arm_files import arm_document, load_arm
from planners.typing import Array

if TYPE_CHECKING:
    from planners.trajectory.trajectory import Trajectory

FORMAT = 1
"""Version of the NPZ files."""

MOST_BYTES = 1 << 28
"""Largest size of an NPZ file's arrays, bytes."""

COLUMNS = {"q": "rad", "qd": "rad_s", "qdd": "rad_s2", "tau": "N_m"}
"""What is stored of every joint, with the unit in the names."""

NUMBERS = ("cost", "rendezvous_time", "rides_until")


def write_csv(trajectory: Trajectory, path: Path) -> None:
    """Write time and, joint by joint, angles, velocities, accelerations and torques, one row a sample."""
    n = trajectory.q.shape[1]
    names = ["t_s", *(f"{name}{joint + 1}_{unit}" for name, unit in COLUMNS.items() for joint in range(n))]
    rows = np.column_stack([trajectory.t, *(getattr(trajectory, name) for name in COLUMNS)])
    with whole_file(path) as draft:
        np.savetxt(draft, rows, fmt="%.17g", delimiter=",", header=",".join(names), comments="")


def write_npz(trajectory: Trajectory, path: Path) -> None:
    """Write samples and problem; ``read_npz`` gives the same trajectory back."""
    about = {
        "format": FORMAT,
        "planner": trajectory.planner,
        "problem": problem_document(trajectory.problem),
        **{name: _written(getattr(trajectory, name)) for name in NUMBERS},
    }
    arrays = {f"{name}_{unit}": getattr(trajectory, name) for name, unit in COLUMNS.items()}
    with whole_file(path) as draft, draft.open("wb") as file:
        np.savez(file, allow_pickle=False, t_s=trajectory.t, **arrays, about=np.array(json.dumps(about)))


def read_npz(path: Path) -> dict[str, Any]:
    """What a trajectory is made of: its problem, samples and numbers, by name.

    Raises:
        ValueError: if the file is no trajectory of this format.
        OSError: if it cannot be read.
    """
    if not path.exists():
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))
    try:
        stored = read_arrays(path, MOST_BYTES)
        about = parse_json(str(stored["about"]), "about")
        samples = {"t": stored["t_s"], **{name: stored[f"{name}_{unit}"] for name, unit in COLUMNS.items()}}
        if odd := [name for name, array in samples.items() if array.dtype.kind not in "fiu"]:
            raise ValueError(f"{odd[0]} holds no numbers")
        if about["format"] != FORMAT:
            raise ValueError(f"format {about['format']}")
        numbers = {name: _number(about[name]) for name in NUMBERS}
        problem, planner = problem_of(about["problem"]), str(about["planner"])
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, OverflowError) as error:
        raise ValueError(
            f"{path} is no trajectory that planarm has saved ({' '.join(str(error).split())[:300]})"
        ) from error
    samples.pop("tau")  # follows from the motion and the problem's arm
    return {"problem": problem, **samples, **numbers, "planner": planner}


def problem_document(problem: MotionProblem) -> dict[str, Any]:
    """A motion problem in JSON's types, SI units."""
    target = problem.target
    goal = {name: np.asarray(value).tolist() for name, value in vars(target).items() if value is not None}
    return {
        "arm": arm_document(problem.arm),
        "limits": arm_document(replace(problem.arm, limits=problem.joint_limits))["limits"],
        **dict(zip(("q", "qd", "qdd"), (values.tolist() for values in problem.start), strict=True)),
        "target": {"kind": type(target).__name__, **goal},
        "horizon": problem.horizon,
        "payload": problem.payload,
        "obstacles": [[*disc.position, *disc.velocity, disc.radius] for disc in problem.obstacles],
    }


def problem_of(document: Mapping[str, Any]) -> MotionProblem:
    """The motion problem of a document, as `problem_document` gives it; a ValueError if it is none."""
    kinds: dict[str, type[Target]] = {kind.__name__: kind for kind in (FixedJoints, FixedHand, MovingHand)}
    goal = dict(document["target"])
    arm = load_arm(document["arm"])
    return MotionProblem(
        arm,
        document["q"],
        kinds[goal.pop("kind")](**goal),
        document["horizon"],
        qd=document["qd"],
        qdd=document["qdd"],
        limits=load_arm({**document["arm"], "limits": document["limits"]}).limits,
        obstacles=tuple(Obstacle(_vector(row[:2]), _vector(row[2:4]), row[4]) for row in document["obstacles"]),
        payload=document["payload"],
    )


def _vector(values: Any) -> Array:
    return np.array(values, dtype=float)


def _written(value: float) -> float | str | None:
    """A number as JSON can hold it: inf is null, and NaN and -inf are texts."""
    return value if math.isfinite(value) else None if value == math.inf else str(value)


def _number(value: Any) -> float:
    """What `_written` has written."""
    return math.inf if value is None else float(value)
