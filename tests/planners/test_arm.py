"""The arm as a value: defaults, presets, refusals, payloads and pickling."""

from __future__ import annotations

import math
import pickle
from dataclasses import FrozenInstanceError, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planners import PLANAR_3R, SCARA_1M, Arm, JointLimits


def two_links(**changes: Any) -> Arm:
    given = {"name": "pair", "lengths": (1.0, 0.5), "masses": (2.0, 1.0), "limits": JointLimits.unlimited(2)}
    return Arm(**(given | changes))


def test_links_are_uniform_rods_unless_told_otherwise() -> None:
    arm = two_links()
    assert arm.coms == (0.5, 0.25)
    assert arm.inertias == pytest.approx((2.0 / 12.0, 0.25 / 12.0))
    assert (arm.gravity, arm.base, arm.n_joints, arm.reach) == (0.0, (0.0, 0.0), 2, 1.5)


def test_presets_are_the_arms_of_the_papers() -> None:
    assert SCARA_1M.limits == JointLimits(
        torque=(0.5, 0.2), velocity=(0.2, 0.2), acceleration=(0.3, 0.3), jerk=(2.3, 2.0), angle=(math.inf, math.inf)
    )
    assert (SCARA_1M.lengths, SCARA_1M.masses, SCARA_1M.gravity) == ((1.0, 1.0), (1.0, 1.0), 0.0)
    assert (PLANAR_3R.lengths, PLANAR_3R.masses, PLANAR_3R.reach) == ((0.2, 0.4, 0.2), (1.0, 2.0, 1.0), 0.8)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"lengths": (1.0, -0.5)}, r"pair: lengths \(1.0, -0.5\) must be finite and positive"),
        ({"lengths": (1.0, 0.0)}, r"lengths \(1.0, 0.0\)"),
        ({"masses": (2.0, -1.0)}, r"masses \(2.0, -1.0\)"),
        ({"masses": (2.0, 0.0)}, r"masses \(2.0, 0.0\)"),
        ({"masses": (2.0, math.nan)}, r"masses \(2.0, nan\)"),
        ({"masses": (2.0, math.inf)}, r"masses \(2.0, inf\)"),
        ({"coms": (-0.1, 0.2)}, r"coms \(-0.1, 0.2\)"),
        ({"inertias": (0.1, -0.2)}, r"inertias \(0.1, -0.2\)"),
        ({"inertias": (0.1, math.nan)}, r"inertias \(0.1, nan\)"),
        ({"coms": (0.5, 0.0), "inertias": (0.1, 0.0)}, "link 1 has com 0 and inertia 0"),
        ({"masses": (2.0,)}, "1 masses for 2 links; give one per link"),
        ({"masses": (2.0, 1.0, 1.0)}, "3 masses for 2 links"),
        ({"coms": (0.1,)}, "1 coms for 2 links"),
        ({"inertias": (0.1, 0.1, 0.1)}, "3 inertias for 2 links"),
        ({"lengths": (), "masses": ()}, "at least one link"),
        ({"limits": JointLimits.unlimited(3)}, "limits are given for 3 joints, pair has 2"),
        ({"gravity": math.inf}, r"gravity inf m/s\^2 must be finite"),
        ({"gravity": math.nan}, r"gravity nan m/s\^2 must be finite"),
        ({"base": (0.0, math.nan)}, r"base \(0.0, nan\) must be 2 finite numbers"),
        ({"base": (0.0, 0.0, 0.0)}, r"base \(0.0, 0.0, 0.0\) must be 2 finite numbers"),
    ],
)
def test_impossible_arms_are_refused_by_value(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        two_links(**changes)


@pytest.mark.parametrize("kind", ["torque", "velocity", "acceleration", "jerk", "angle"])
@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan])
def test_limits_must_be_positive(kind: str, bad: float) -> None:
    with pytest.raises(ValueError, match=rf"{kind} limits \(1.0, {bad}\) must be positive; use inf"):
        JointLimits(**({"torque": (1.0, 1.0)} | {kind: (1.0, bad)}))


def test_limits_are_one_per_joint() -> None:
    with pytest.raises(ValueError, match="velocity limits: 3 values for 2 joints"):
        JointLimits(torque=(1.0, 1.0), velocity=(1.0, 1.0, 1.0))


def test_limits_left_out_are_infinite() -> None:
    limits = JointLimits(torque=(1.0, 2.0))
    assert limits.velocity == limits.acceleration == limits.jerk == limits.angle == (math.inf, math.inf)
    assert JointLimits.unlimited(1) == JointLimits(torque=(math.inf,))


def test_scaled_limits_keep_the_joint_range() -> None:
    limits = JointLimits((2.0,), velocity=(4.0,), acceleration=(6.0,), jerk=(8.0,), angle=(3.0,)).scaled(0.5)
    assert limits == JointLimits((1.0,), velocity=(2.0,), acceleration=(3.0,), jerk=(4.0,), angle=(3.0,))


def test_arms_cannot_be_changed() -> None:
    with pytest.raises(FrozenInstanceError):
        SCARA_1M.gravity = 9.81  # type: ignore[misc]


def test_lists_and_integers_will_do() -> None:
    arm = two_links(lengths=[1, 0.5], masses=[2, 1])
    assert arm == two_links()
    assert hash(arm) == hash(two_links())
    np.testing.assert_array_equal(arm.mass_matrix([0.1, 0.2]), two_links().mass_matrix([0.1, 0.2]))


@given(st.floats(0.0, 10.0), st.floats(0.0, 0.8), st.floats(1e-3, 1.0))
@settings(deadline=None)
def test_payload_makes_a_composite_last_link(payload: float, com: float, inertia: float) -> None:
    """Composite body: total mass, first moment and moment about the last joint add up."""
    arm = two_links(coms=(0.5, com), inertias=(0.1, inertia))
    loaded = arm.with_payload(payload)
    mass, length = arm.masses[1], arm.lengths[1]
    assert loaded.masses[1] == pytest.approx(mass + payload)
    assert loaded.masses[1] * loaded.coms[1] == pytest.approx(mass * com + payload * length)
    about_joint = inertia + mass * com**2 + payload * length**2
    assert loaded.inertias[1] + loaded.masses[1] * loaded.coms[1] ** 2 == pytest.approx(about_joint)
    assert (loaded.masses[0], loaded.coms[0], loaded.inertias[0]) == (2.0, 0.5, 0.1)
    assert (loaded.lengths, loaded.limits) == (arm.lengths, arm.limits)


def test_no_payload_is_the_arm_itself() -> None:
    assert SCARA_1M.with_payload(0.0) is SCARA_1M


@pytest.mark.parametrize("mass", [-0.1, math.nan, math.inf])
def test_impossible_payloads_are_refused_by_value(mass: float) -> None:
    with pytest.raises(ValueError, match=f"payload mass {mass} kg must be finite and not negative"):
        SCARA_1M.with_payload(mass)


def test_pickling_keeps_the_arm() -> None:
    used = replace(PLANAR_3R, gravity=9.81)
    used.mass_matrix([0.1, 0.2, 0.3])  # fills the cached constants
    copy = pickle.loads(pickle.dumps(used))
    assert copy == used
    assert hash(copy) == hash(used)
    q = np.array([0.3, -0.2, 1.0])
    np.testing.assert_array_equal(copy.inverse_dynamics(q, q, q), used.inverse_dynamics(q, q, q))


@pytest.mark.parametrize(
    "given",
    [
        {"lengths": [1e200, 1.0], "masses": [1.0, 1.0]},
        {"lengths": [1.0, 1.0], "masses": [1e200, 1e300]},
        {"lengths": [1.0, 1.0], "masses": [1.0, 1.0], "base": list(range(5000))},
        {"lengths": [1e10] * 3000, "masses": [1.0] * 3000},
        {"lengths": [-1.0] * 3000, "masses": [1.0] * 3000},
        {"name": "x" * 9000, "lengths": 1.0, "masses": 1.0},
    ],
)
def test_extreme_numbers_are_refused_in_a_short_sentence(given: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="must be") as refusal:
        Arm(**{"name": "large", **given})
    assert len(str(refusal.value)) < 300
