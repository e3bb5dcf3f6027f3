"""Distances between an arm and a disc, against a sampled outline and known postures."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planners import PLANAR_3R, SCARA_50CM

angles = st.floats(-3.0, 3.0)
places = st.floats(-1.5, 1.5)


@settings(deadline=None)
@given(st.tuples(angles, angles), st.tuples(places, places), st.floats(0.0, 0.3))
def test_it_is_the_distance_to_the_nearest_of_many_points_of_the_arm(
    q: tuple[float, float], center: tuple[float, float], radius: float
) -> None:
    joints = SCARA_50CM.joint_positions(q)
    shares = np.linspace(0.0, 1.0, 2001)[:, None]
    points = np.concatenate([a + shares * (b - a) for a, b in pairwise(joints)])
    sampled = np.hypot(*(points - center).T).min() - SCARA_50CM.link_radius - radius
    exact = SCARA_50CM.clearance(q, center, radius)
    assert exact <= sampled + 1e-12
    assert sampled - exact <= 0.5 / 2000  # half a spacing is the most that sampling can miss


def test_known_postures() -> None:
    assert SCARA_50CM.clearance([0.0, 0.0], [1.3, 0.0], 0.1) == pytest.approx(0.3 - 0.1 - 0.045)
    assert SCARA_50CM.clearance([0.0, np.pi / 2], [0.2, -0.5], 0.1) == pytest.approx(0.5 - 0.1 - 0.045)
    assert SCARA_50CM.clearance([0.0, np.pi / 2], [0.5, 0.25], 0.1) == pytest.approx(-0.145)


def test_environments_agree_with_single_postures_on_any_arm() -> None:
    arm = replace(PLANAR_3R, base=(0.3, -0.1), link_radius=0.02)
    rng = np.random.default_rng(0)
    q, centers = rng.uniform(-3.0, 3.0, (20, 3)), rng.uniform(-1.0, 1.0, (20, 2))
    together = arm.clearance(q, centers, 0.05)
    assert together.shape == (20,)
    np.testing.assert_array_equal(
        together, [arm.clearance(one, center, 0.05) for one, center in zip(q, centers, strict=True)]
    )


def test_a_link_radius_that_is_none_is_refused() -> None:
    with pytest.raises(ValueError, match=r"link_radius -0\.1 m must be finite and not negative"):
        replace(SCARA_50CM, link_radius=-0.1)


def test_a_posture_or_a_disc_that_is_no_number_is_not_far_away() -> None:
    assert np.isnan(SCARA_50CM.clearance([np.nan, 0.0], [1.0, 1.0], 0.1))
    assert np.isnan(SCARA_50CM.clearance([0.0, 0.0], [np.nan, 1.0], 0.1))
