"""Trajectories saved, loaded, exported, plotted and filmed."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planners import (
    PLANAR_3R,
    SCARA_50CM,
    FixedHand,
    FixedJoints,
    JointLimits,
    MotionProblem,
    MovingHand,
    Obstacle,
    Trajectory,
    quintic,
    sampled_trajectory,
)
from planners.trajectory.files import problem_document, problem_of

PROBLEM = MotionProblem(
    SCARA_50CM,
    [0.2, 1.5],
    FixedJoints([1.2, 0.8]),
    2.0,
    limits=JointLimits(torque=9.0, velocity=2.0, angle=[(-1.0, 2.5), 2.6]),
    obstacles=(Obstacle([-0.5, -0.5], [0.1, 0.0], 0.1),),
    payload=0.25,
)


@pytest.fixture(scope="module")
def motion() -> Trajectory:
    return quintic.plan(PROBLEM)


def test_a_saved_trajectory_is_loaded_to_the_bit(motion: Trajectory, tmp_path: Path) -> None:
    motion.save(tmp_path / "motion.npz")
    back = Trajectory.load(tmp_path / "motion.npz")
    for name in ("t", "q", "qd", "qdd", "tau"):
        np.testing.assert_array_equal(getattr(back, name), getattr(motion, name))
    assert repr(back) == repr(motion)
    assert back.limit_ratios == motion.limit_ratios
    assert (back.clearance, back.cost, back.rendezvous_time) == (motion.clearance, motion.cost, motion.rendezvous_time)
    assert problem_document(back.problem) == problem_document(PROBLEM)
    assert back == motion


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
def test_numbers_that_are_none_are_kept(number: float, motion: Trajectory, tmp_path: Path) -> None:
    replace(motion, cost=number, rides_until=number).save(tmp_path / "motion.npz")
    back = Trajectory.load(tmp_path / "motion.npz")
    np.testing.assert_array_equal([back.cost, back.rides_until], [number, number])


@given(st.sampled_from([FixedHand([0.3, 0.2]), FixedHand([0.3, 0.2], 0.4), MovingHand([0.1, 0.2], [0.3, 0.0])]))
@settings(deadline=None)
def test_every_kind_of_problem_survives_json(target: FixedHand | MovingHand) -> None:
    problem = MotionProblem(PLANAR_3R, [0.1, 0.2, 0.3], target, 1.5, qd=[0.1, 0.0, -0.2])
    document = json.loads(json.dumps(problem_document(problem)))
    assert problem_document(problem_of(document)) == problem_document(problem)


@pytest.mark.parametrize("damage", ["empty", "cut", "text", "another archive", "pickle", "format"])
def test_a_file_that_is_no_trajectory_is_refused_in_one_sentence(
    damage: str, motion: Trajectory, tmp_path: Path
) -> None:
    path = tmp_path / "motion.npz"
    motion.save(path)
    whole = path.read_bytes()
    if damage == "empty":
        path.write_bytes(b"")
    elif damage == "cut":
        path.write_bytes(whole[: len(whole) // 2])
    elif damage == "text":
        path.write_text("no archive")
    elif damage == "another archive":
        np.savez(path, x=np.zeros(3))
    elif damage == "pickle":
        np.savez(path, about=np.array([{}], dtype=object))
    else:
        with np.load(path) as stored:
            arrays = dict(stored)
        np.savez(path, **{**arrays, "about": np.array(json.dumps({**json.loads(str(arrays["about"])), "format": 99}))})
    with pytest.raises(ValueError, match="is no trajectory that planarm has saved"):
        Trajectory.load(path)
    with pytest.raises(FileNotFoundError):
        Trajectory.load(tmp_path / "missing.npz")


def test_csv_has_a_row_a_sample_with_units_in_its_names(motion: Trajectory, tmp_path: Path) -> None:
    motion.to_csv(tmp_path / "motion.csv")
    table = np.genfromtxt(tmp_path / "motion.csv", delimiter=",", names=True)
    assert table.dtype.names == (
        "t_s",
        *("q1_rad", "q2_rad", "qd1_rad_s", "qd2_rad_s"),
        *("qdd1_rad_s2", "qdd2_rad_s2", "tau1_N_m", "tau2_N_m"),
    )
    np.testing.assert_array_equal(table["t_s"], motion.t)
    np.testing.assert_array_equal(table["qdd2_rad_s2"], motion.qdd[:, 1])


def test_a_plot_shows_every_joint_and_its_limits(motion: Trajectory, tmp_path: Path) -> None:
    figure = motion.plot(tmp_path / "motion.png")
    assert (tmp_path / "motion.png").read_bytes().startswith(b"\x89PNG")
    angles, velocities, accelerations, torques = figure.axes
    np.testing.assert_array_equal(angles.lines[0].get_ydata(), motion.q[:, 0])

    def levels(axes: object) -> set[float]:
        dashed = [line for line in axes.lines if line.get_linestyle() == "--"]  # type: ignore[attr-defined]
        return {round(float(line.get_ydata()[0]), 9) for line in dashed}

    assert levels(angles) == {-1.0, 2.5, -2.6, 2.6}
    assert levels(velocities) == {-2.0, 2.0}
    assert levels(accelerations) == set()
    assert levels(torques) == {-9.0, 9.0}


@pytest.mark.parametrize("name", ["motion", "motion.npz", ".png"])
def test_a_plot_in_a_format_that_is_none_is_refused_with_those_that_are(
    name: str, motion: Trajectory, tmp_path: Path
) -> None:
    with pytest.raises(ValueError, match=rf"file format of .*{name}: .*\.pdf, .*\.png"):
        motion.plot(tmp_path / name)
    assert not any(tmp_path.iterdir())


def test_a_film_shows_the_arm_moving(motion: Trajectory, tmp_path: Path) -> None:
    from PIL import Image

    motion.animate(tmp_path / "motion.gif", fps=10, width=320)
    with Image.open(tmp_path / "motion.gif") as film:
        assert film.n_frames == 21  # type: ignore[attr-defined]
        first = np.asarray(film.convert("RGB")).copy()
        film.seek(10)
        assert (np.asarray(film.convert("RGB")) != first).any()
    with pytest.raises(ValueError, match="file format"):
        motion.animate(tmp_path / "motion.txt")


def test_its_repr_is_one_line_with_duration_worst_limit_and_clearance(motion: Trajectory) -> None:
    line = repr(motion)
    assert "\n" not in line
    assert "quintic" in line
    assert "2 s" in line
    assert f"clearance {1e3 * motion.clearance:.4g} mm" in line
    worst = max(motion.limit_ratios, key=lambda kind: motion.limit_ratios[kind])
    assert f"{worst} at {100.0 * motion.limit_ratio:.4g} % of its limit" in line
    free = MotionProblem(SCARA_50CM, [0.0, 1.0], FixedJoints([0.0, 1.0]), 1.0, limits=JointLimits.unlimited(2))
    still = sampled_trajectory(free, [0.0, 1.0], [[0.0, 1.0]] * 2, np.zeros((2, 2)), np.zeros((2, 2)), planner="still")
    assert repr(still) == "<Trajectory by still: 1 s, no limits, 2 samples>"
