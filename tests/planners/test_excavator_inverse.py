"""Inverse kinematics of the excavator attachment: every branch, singular postures, targets out of reach."""

from __future__ import annotations

import dataclasses
import math
import re

import numpy as np
import pytest
from excavator_cases import (
    LIMIT,
    MACHINES,
    POSTURE,
    every_machine,
    pose_error,
    random_postures,
    seed_error,
    with_geometry,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import least_squares

from planners.excavator import (
    BRANCH_NAMES,
    EXCAVATOR,
    Branches,
    Excavator,
    IKStatus,
    forward_kinematics,
    frames,
    inverse_kinematics,
    jacobian,
    jacobian_determinant,
)
from planners.typing import Array


def target_status(solved: Branches) -> NDArray[np.int64]:
    """Flags of each target's usable branches or, if it has none, of all."""
    counted = solved.usable | ~solved.usable.any(axis=-1, keepdims=True)
    flags: NDArray[np.int64] = np.bitwise_or.reduce(np.where(counted, solved.status, 0), axis=-1)
    return flags


def nearest_q(solved: Branches) -> Array:
    """The posture of each target's nearest branch; NaN where none is usable."""
    index = np.maximum(solved.nearest, 0)[..., None, None]
    chosen = np.take_along_axis(solved.q, index, axis=-2)[..., 0, :]
    return np.where(solved.nearest[..., None] >= 0, chosen, np.nan)


def test_every_branch_of_a_hundred_thousand_poses_is_exact_and_the_seed_is_among_them() -> None:
    q = random_postures(100_000)
    tip, axis = forward_kinematics(q)
    solved = inverse_kinematics(tip, axis)
    there = np.isfinite(solved.q).all(axis=-1)
    position, direction = pose_error(solved.q, tip, axis)
    assert position <= 1e-12
    assert direction <= 1e-12
    assert seed_error(solved.q, q) <= 1e-8
    gone = (solved.status & (IKStatus.SHOULDER | IKStatus.ELBOW)) != 0
    np.testing.assert_array_equal(gone, ~there)
    np.testing.assert_array_equal(np.isnan(solved.q).all(axis=-1), ~there)
    np.testing.assert_array_equal(np.isnan(solved.theta6), ~there)
    np.testing.assert_array_equal(solved.usable, there & (np.abs(solved.q) <= LIMIT + 1e-9).all(axis=-1))
    np.testing.assert_array_equal(target_status(solved) & ~IKStatus.BUCKET, 0)
    # percentages that an independent implementation found for this distribution of poses
    found = np.bincount(there.sum(axis=-1), minlength=9) / 1000.0
    np.testing.assert_allclose(found, [0.0, 0.0, 2.2, 0.0, 18.4, 0.0, 3.3, 0.0, 76.0], atol=0.6)
    in_range = np.bincount(solved.usable.sum(axis=-1), minlength=9) / 1000.0
    np.testing.assert_allclose(in_range, [0.0, 3.4, 15.9, 16.8, 20.6, 11.1, 17.0, 10.9, 4.3], atol=0.6)


@pytest.mark.parametrize("machine", MACHINES[1:], ids=["odd-1", "odd-2", "odd-3"])
def test_other_geometries_are_solved_as_well(machine: Excavator) -> None:
    q = random_postures(5000, seed=4)
    tip, axis = forward_kinematics(q, machine)
    solved = inverse_kinematics(tip, axis, machine=machine)
    position, direction = pose_error(solved.q, tip, axis, machine)
    assert position <= 1e-12
    assert direction <= 1e-12
    assert seed_error(solved.q, q) <= 1e-8


def test_a_numerical_search_finds_no_posture_but_the_branches() -> None:
    rng = np.random.default_rng(5)
    for seed in random_postures(4, seed=6):
        tip, axis = forward_kinematics(seed)
        branches = inverse_kinematics(tip, axis).q
        there = np.isfinite(branches).all(axis=-1)

        def residual(q: Array, tip: Array = tip, axis: Array = axis) -> Array:
            reached_tip, reached_axis = forward_kinematics(q)
            return np.concatenate([reached_tip - tip, reached_axis - axis])

        met = set()
        for start in rng.uniform(-np.pi, np.pi, (60, 5)):
            search = least_squares(residual, start, xtol=1e-15, ftol=1e-15, gtol=1e-15)
            if search.cost < 1e-20:
                turns = np.abs(np.exp(1j * branches[there]) - np.exp(1j * search.x)).max(axis=-1)
                assert turns.min() < 1e-6
                met.add(int(np.argmin(turns)))
        assert len(met) == there.sum()


def test_branches_are_what_their_names_say() -> None:
    tip, axis = forward_kinematics(random_postures(300, seed=7))
    solved = inverse_kinematics(tip, axis)
    front = (frames(np.nan_to_num(solved.q))[..., 5, :3, 3] * frames(np.nan_to_num(solved.q))[..., 1, :3, 0]).sum(-1)
    for index, name in enumerate(BRANCH_NAMES):
        there = np.isfinite(solved.q[:, index, 0])
        q = solved.q[there, index]
        assert ((front[there, index] > 0.0) == ("facing" in name)).all()
        assert ((q[:, 4] > 0.0) == ("bucket down" in name)).all()
        assert ((q[:, 2] > 0.0) == ("elbow down" in name)).all()


@settings(deadline=None, max_examples=200)
@given(
    tip=st.tuples(*[st.floats(-6.0, 6.0)] * 3),
    axis=st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda v: math.hypot(*v) > 1e-3),
)
def test_any_target_has_exact_branches_or_says_why_not(
    tip: tuple[float, float, float], axis: tuple[float, float, float]
) -> None:
    solved = inverse_kinematics(tip, axis)
    there = np.isfinite(solved.q).all(axis=-1)
    np.testing.assert_array_equal(there, (solved.status & (IKStatus.SHOULDER | IKStatus.ELBOW | IKStatus.TOOL)) == 0)
    if there.any():
        position, direction = pose_error(solved.q, np.array(tip), np.array(axis) / math.hypot(*axis))
        assert position <= 2e-12
        assert direction <= 2e-12
    if not solved.usable.any():
        assert target_status(solved) != 0
        assert solved.nearest == -1


# Singular postures and targets out of reach


@pytest.mark.parametrize("q5", [1e-2, 1e-4, 1e-6, 1e-8, -1e-8, 1e-10, 1e-12])
def test_close_to_the_bucket_singularity_positions_stay_exact(q5: float) -> None:
    q = random_postures(5000, seed=8)
    q[:, 4] = q5
    tip, axis = forward_kinematics(q)
    solved = inverse_kinematics(tip, axis)
    assert np.isfinite(solved.q).all(axis=-1).any(axis=-1).all()
    position, direction = pose_error(solved.q, tip, axis)
    assert position <= 1e-12
    assert direction <= 1e-12
    # The axis holds theta234 to its rounding over sin(theta5). Close to the two other singularities more is lost.
    regular = np.abs(jacobian_determinant(q) / np.sin(q[:, 4])) > 0.1
    assert regular.sum() > 4000
    assert seed_error(solved.q[regular], q[regular]) <= 1e-13 / abs(q5) + 1e-12


def test_a_wrist_on_the_rim_of_its_reach_is_solved_close_to_the_bucket_singularity() -> None:
    # rounding of 1e-16 leaves theta234 uncertain by 1e-8 rad and the wrist 1e-9 m out of reach, but the arm is
    # stretched to 1e-10 m: the solution must use that a pitch next to the computed one serves as well
    q = np.array([1.8, 1.1, -1.5e-5, 2.3, -1e-8])
    rows = q + np.random.default_rng(0).uniform(-0.01, 0.01, (500, 5)) * [1.0, 1.0, 0.0, 1.0, 0.0]
    tip, axis = forward_kinematics(rows)
    solved = inverse_kinematics(tip, axis, near=rows)
    assert pose_error(solved.q, tip, axis)[0] <= 1e-12
    np.testing.assert_allclose(nearest_q(solved), rows, rtol=0.0, atol=1e-3)


@pytest.mark.parametrize("q5", [0.0, 1e-14, np.pi])
def test_at_the_bucket_singularity_the_current_posture_decides(q5: float) -> None:
    q = random_postures(5000, seed=9)
    q[:, 4] = q5
    tip, axis = forward_kinematics(q)
    solved = inverse_kinematics(tip, axis, near=q)
    assert ((solved.status & IKStatus.BUCKET) != 0).any(axis=-1).all()
    position, direction = pose_error(solved.q, tip, axis)
    assert position <= 1e-12
    assert direction <= 1e-12
    assert seed_error(solved.q, q) <= 1e-8
    if q5 == 0.0:
        np.testing.assert_allclose(nearest_q(solved), q, rtol=0.0, atol=1e-8)
        assert ((target_status(solved) & IKStatus.BUCKET) != 0).all()


@pytest.mark.parametrize("machine", [MACHINES[0], MACHINES[1], MACHINES[3]], ids=["excavator", "odd-1", "odd-3"])
def test_at_the_bucket_singularity_the_pitch_moves_only_as_far_as_the_elbow_needs(machine: Excavator) -> None:
    q = random_postures(3000, seed=10)
    q[:, 4] = 0.0
    tip, axis = forward_kinematics(q, machine)
    solved = inverse_kinematics(tip, axis, machine=machine)
    singular = ((solved.status & IKStatus.BUCKET) != 0) & np.isfinite(solved.q).all(axis=-1)
    assert singular.any(axis=-1).all()
    assert pose_error(solved.q, tip, axis, machine)[0] <= 1e-12
    moved = np.abs(np.angle(np.exp(1j * solved.q[..., 1:4].sum(axis=-1))))
    on_the_rim = np.abs(np.sin(solved.q[..., 2])) < 1e-6
    kept = moved < 1e-12
    assert (kept | on_the_rim)[singular].all()
    assert kept[singular].any()
    assert (singular & ~kept).any()
    # nothing between: the wrist at any smaller turn is out of reach of boom and arm
    geometry = machine.geometry
    wrist = tip - geometry.d6 * axis
    rows, branches = np.nonzero(singular & ~kept)
    theta = np.angle(np.exp(1j * solved.q[rows, branches]))
    front = wrist[rows, 0] * np.cos(theta[:, 0]) + wrist[rows, 1] * np.sin(theta[:, 0])
    turn = np.angle(np.exp(1j * theta[:, 1:4].sum(axis=-1)))
    for fraction in (-0.999, -0.5, 0.0, 0.5, 0.999):
        pitch = fraction * turn
        x = front - geometry.d5 * np.sin(pitch)
        y = wrist[rows, 2] - geometry.d1 + geometry.d5 * np.cos(pitch)
        span = np.hypot(x, y)
        assert ((span > geometry.a2 + geometry.a3) | (span < abs(geometry.a2 - geometry.a3))).all()


def test_a_wrist_too_close_to_the_slewing_axis_is_named() -> None:
    rng = np.random.default_rng(11)
    radius, angle = rng.uniform(0.0, 0.1999, 5000), rng.uniform(-np.pi, np.pi, 5000)
    axis = rng.normal(size=(5000, 3))
    axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
    wrist = np.stack([radius * np.cos(angle), radius * np.sin(angle), rng.uniform(-1.0, 3.0, 5000)], axis=-1)
    solved = inverse_kinematics(wrist + 0.55 * axis, axis)
    assert np.isnan(solved.q).all()
    np.testing.assert_array_equal(solved.status, int(IKStatus.SHOULDER))
    np.testing.assert_array_equal(target_status(solved), int(IKStatus.SHOULDER))
    np.testing.assert_array_equal(solved.nearest, -1)


def test_a_wrist_beside_the_slewing_axis_is_still_solved() -> None:
    q = random_postures(2000, seed=12)
    boom, arm = q[:, 1], q[:, 1] + q[:, 2]
    reach = -(2.45 * np.cos(boom) + 1.40 * np.cos(arm)) / 0.35
    q = q[np.abs(reach) <= 1.0]
    q[:, 3] = np.arcsin(reach[np.abs(reach) <= 1.0]) - q[:, 1] - q[:, 2]
    assert len(q) > 50
    np.testing.assert_allclose(jacobian_determinant(q), 0.0, atol=1e-14)
    tip, axis = forward_kinematics(q)
    solved = inverse_kinematics(tip, axis)
    assert np.isfinite(solved.q).all(axis=-1).any(axis=-1).all()
    assert pose_error(solved.q, tip, axis)[0] <= 1e-12


def test_targets_beyond_the_elbow_are_named() -> None:
    rng = np.random.default_rng(13)
    far = rng.normal(size=(1000, 3))
    far *= rng.uniform(6.0, 100.0, (1000, 1)) / np.linalg.norm(far, axis=-1, keepdims=True)
    far[np.hypot(far[:, 0], far[:, 1]) < 1.0, 0] += 2.0
    solved = inverse_kinematics(far, rng.normal(size=(1000, 3)))
    assert np.isnan(solved.q).all()
    np.testing.assert_array_equal(solved.status, int(IKStatus.ELBOW))
    np.testing.assert_array_equal(target_status(solved), int(IKStatus.ELBOW))


def test_the_stretched_arm_has_its_two_elbow_branches_in_one() -> None:
    q = np.array([0.3, 0.4, 0.0, -0.8, 1.1])
    solved = inverse_kinematics(*forward_kinematics(q), near=q)
    np.testing.assert_allclose(nearest_q(solved), q, rtol=0.0, atol=1e-7)
    assert pose_error(solved.q, *forward_kinematics(q))[0] <= 1e-12


def test_a_joint_out_of_range_is_flagged_and_still_given() -> None:
    q = np.radians([10.0, 20.0, -40.0, 160.0, 70.0])
    tip, axis = forward_kinematics(q)
    solved = inverse_kinematics(tip, axis, near=q)
    index = int(np.nanargmin(np.abs(solved.q - q).max(axis=-1)))
    np.testing.assert_allclose(solved.q[index], q, atol=1e-12)
    assert solved.status[index] == IKStatus.RANGE
    assert solved.nearest != index
    assert f"{BRANCH_NAMES[index]}: RANGE (wrist at 160.0 deg of +-150)" in solved.explain().splitlines()


def test_a_posture_on_the_limits_of_its_joints_is_inside() -> None:
    corners = LIMIT * np.array(np.meshgrid(*[[-1.0, 1.0]] * 5)).reshape(5, -1).T
    solved = inverse_kinematics(*forward_kinematics(corners), near=corners)
    np.testing.assert_allclose(nearest_q(solved), corners, atol=1e-9)


# A whole orientation


@every_machine
def test_the_sixth_angle_completes_the_orientation_of_every_branch(machine: Excavator) -> None:
    q = random_postures(40, seed=14)
    pose = frames(q, machine)[:, 6]
    solved = inverse_kinematics(pose[:, :3, 3], pose[:, :3, 2], tool_x=pose[:, :3, 0], machine=machine)
    there = np.isfinite(solved.q).all(axis=-1)
    rows, branches = np.nonzero(there)
    for row, branch in zip(rows, branches, strict=True):
        geometry = dataclasses.replace(machine.geometry, theta6=float(solved.theta6[row, branch]))
        reached = frames(solved.q[row, branch], with_geometry(geometry))[6]
        np.testing.assert_allclose(reached, pose[row], rtol=0.0, atol=1e-11)


def test_a_full_pose_leaves_the_seed_and_perhaps_its_other_elbow() -> None:
    q = random_postures(20_000, seed=15)
    pose = frames(q)[:, 6]
    solved = inverse_kinematics(pose[:, :3, 3], pose[:, :3, 2], tool_x=pose[:, :3, 0], full_pose=True, near=q)
    np.testing.assert_allclose(nearest_q(solved), q, rtol=0.0, atol=1e-8)
    # the other elbow is in range in seven poses of ten, an independent implementation found
    in_range = np.bincount(solved.usable.sum(axis=-1), minlength=3) / 200.0
    np.testing.assert_allclose(in_range, [0.0, 29.0, 71.0], atol=1.5)


@pytest.mark.parametrize("q5", [1.0, 1e-2, 1e-5, 1e-8, -1e-8, 1e-12])
def test_a_full_pose_is_exact_close_to_the_bucket_singularity_too(q5: float) -> None:
    q = random_postures(3000, seed=19)
    q[:, 4] = q5
    q = q[np.abs(jacobian_determinant(q) / np.sin(q5)) > 0.1]  # away from the two other singularities
    pose = frames(q)[:, 6]
    solved = inverse_kinematics(pose[:, :3, 3], pose[:, :3, 2], tool_x=pose[:, :3, 0], full_pose=True, near=q)
    there = np.isfinite(solved.q).all(axis=-1)
    np.testing.assert_array_equal(there.sum(axis=-1), 2)
    rows, _ = np.nonzero(there)
    reached = frames(solved.q[there])[:, 6]
    np.testing.assert_allclose(reached[:, :3, 3], pose[rows, :3, 3], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(reached, pose[rows], rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(nearest_q(solved), q, rtol=0.0, atol=1e-8)


def test_a_full_pose_the_mounted_tool_cannot_have_is_named() -> None:
    pose = frames(POSTURE)[6]
    turned = pose[:3, 0] * math.cos(0.1) + pose[:3, 1] * math.sin(0.1)
    solved = inverse_kinematics(pose[:3, 3], pose[:3, 2], tool_x=turned, full_pose=True)
    assert np.isnan(solved.q).all()
    np.testing.assert_array_equal(solved.status & IKStatus.TOOL, int(IKStatus.TOOL))
    free = inverse_kinematics(pose[:3, 3], pose[:3, 2], tool_x=turned, near=POSTURE)
    assert free.theta6[free.nearest] == pytest.approx(0.1, abs=1e-12)


# The door


def test_the_nearest_branch_has_the_least_weighted_distance() -> None:
    q = random_postures(400, seed=16)
    near = random_postures(400, seed=17)
    tip, axis = forward_kinematics(q)
    for weights in (None, (1.0, 4.0, 0.5, 0.0, 2.0)):
        solved = inverse_kinematics(tip, axis, near=near, weights=weights)
        scale = np.ones(5) if weights is None else np.array(weights)
        for row in range(400):
            distances = {
                branch: float(np.sqrt((((solved.q[row, branch] - near[row]) * scale) ** 2).sum()))
                for branch in range(8)
                if solved.usable[row, branch]
            }
            assert distances[int(solved.nearest[row])] == pytest.approx(min(distances.values()), abs=1e-12)


def test_leading_axes_broadcast_and_a_single_target_equals_its_environment() -> None:
    q = random_postures(6, seed=18).reshape(2, 3, 5)
    tip, axis = forward_kinematics(q)
    assert tip.shape == axis.shape == (2, 3, 3)
    assert frames(q).shape == (2, 3, 7, 4, 4)
    assert jacobian(q).shape == (2, 3, 6, 5)
    assert jacobian_determinant(q).shape == (2, 3)
    batch = inverse_kinematics(tip, 3.0 * axis, near=POSTURE)
    assert batch.q.shape == (2, 3, 8, 5)
    assert batch.theta6.shape == batch.status.shape == batch.usable.shape == (2, 3, 8)
    assert batch.nearest.shape == target_status(batch).shape == (2, 3)
    assert nearest_q(batch).shape == (2, 3, 5)
    single = inverse_kinematics(tip[1, 2], 3.0 * axis[1, 2], near=POSTURE)
    assert single.q.shape == (8, 5)
    assert nearest_q(single).shape == (5,)
    np.testing.assert_array_equal(single.q, batch.q[1, 2])
    assert single.explain() == batch.explain((1, 2))
    one_axis = inverse_kinematics(tip, axis[0, 0])
    np.testing.assert_array_equal(one_axis.q[0, 0], inverse_kinematics(tip[0, 0], axis[0, 0]).q)
    assert inverse_kinematics(np.empty((0, 3)), axis[0, 0]).q.shape == (0, 8, 5)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"tip": [1.0, 2.0]}, "tip has shape (2,); give (..., 3)"),
        ({"tip": [1.0, 2.0, math.nan]}, "tip must be finite; got nan"),
        ({"axis": [0.0, 0.0, 0.0]}, "axis has length 0"),
        ({"axis": 1.0}, "axis has shape ()"),
        ({"near": [0.0, 0.0]}, "near has shape (2,); give (..., 5)"),
        ({"near": [0.0, 0.0, math.inf, 0.0, 0.0]}, "near must be finite; got inf"),
        ({"weights": [1.0, 1.0, 1.0, 1.0, -1.0]}, "weights ["),
        ({"weights": [1.0]}, "weights has shape (1,); it must have (5,)"),
        ({"full_pose": True}, "give tool_x beside the axis"),
        ({"tool_x": [0.0, 0.6, 0.8]}, "tool_x must be at a right angle"),
    ],
)
def test_wrong_arguments_are_refused(arguments: dict[str, object], message: str) -> None:
    target: dict[str, object] = {"tip": [2.0, 0.0, 1.0], "axis": [0.0, 0.0, -1.0]}
    with pytest.raises(ValueError, match=re.escape(message)):
        inverse_kinematics(**(target | arguments))  # type: ignore[arg-type]


def test_ranges_around_any_angle_hold_and_turn_the_branches() -> None:
    """A machine whose slew goes from 1 to 5 rad, more than half a turn from 0, and whose boom only goes up."""
    ranges = ((1.0, 5.0), (0.1, 1.2), (-2.6, 0.2), 2.6, 2.6)
    machine = dataclasses.replace(EXCAVATOR, limits=dataclasses.replace(EXCAVATOR.limits, angle=ranges))
    limits = machine.limits
    q = np.random.default_rng(3).uniform(limits.angle_lower, limits.angle_upper, (2000, 5))
    tip, axis = forward_kinematics(q, machine=machine)
    solved = inverse_kinematics(tip, axis, near=q, machine=machine)
    usable = solved.usable
    assert usable.any(axis=-1).mean() > 0.99
    outside = ~limits.within(solved.q)
    assert not (usable & outside & (np.abs(solved.q - limits.angle_middle) > limits.angle_half + 1e-9).any(-1)).any()
    moved = np.abs(nearest_q(solved) - q).max(axis=-1)
    assert (moved < 1e-6).mean() > 0.95
    row, branch = np.argwhere((solved.status & IKStatus.RANGE) != 0)[0]
    assert re.search(r"deg of (57 to 286|6 to 69|-149 to 11|\+-149)", solved.explain(int(row)).splitlines()[branch])
