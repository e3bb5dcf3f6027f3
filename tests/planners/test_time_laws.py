"""Time laws from rest to rest against polynomials of NumPy and finite differences."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from planners.motion.time_laws import SHAPES, quintic, quintic_motion, rest_curve_single, shape_functions
from planners.typing import Array

START, GOAL, DURATION = np.array([0.1, -2.0, 0.5]), np.array([1.0, 2.0, 0.5]), 0.8


def curve(coefficients: Array, t: float) -> tuple[Array, Array]:
    q, qd = np.empty(3), np.empty(3)
    rest_curve_single(coefficients, START, GOAL, DURATION, t, q, qd)
    return q, qd


def test_the_quintic_and_its_derivatives() -> None:
    s = np.linspace(0.0, 1.0, 9)
    polynomial = np.polynomial.Polynomial([0.0, 0.0, 0.0, 10.0, -15.0, 6.0])
    for order, values in enumerate(quintic(s)):
        np.testing.assert_allclose(values, polynomial.deriv(order)(s), atol=1e-14)
    motion = quintic_motion(START, GOAL - START, DURATION, s[:, None])
    for order, (start, values) in enumerate(zip((START, 0.0, 0.0), motion, strict=True)):
        expected = start + polynomial.deriv(order)(s)[:, None] * (GOAL - START) / DURATION**order
        np.testing.assert_allclose(values, expected, atol=1e-12)


def test_without_coefficients_it_is_the_quintic() -> None:
    for s in np.linspace(0.0, 1.0, 9):
        q, qd = curve(np.zeros((3, SHAPES)), s * DURATION)
        np.testing.assert_allclose(q, START + (GOAL - START) * (10 * s**3 - 15 * s**4 + 6 * s**5), atol=1e-14)
        speed = 30 * s**2 - 60 * s**3 + 30 * s**4
        np.testing.assert_allclose(qd, (GOAL - START) * speed / DURATION, atol=1e-13)


@given(st.integers(0, 2**32 - 1))
def test_whatever_the_coefficients_it_goes_from_rest_to_rest(seed: int) -> None:
    coefficients = np.random.default_rng(seed).normal(scale=3.0, size=(3, SHAPES))
    for t, end in ((0.0, START), (DURATION, GOAL), (DURATION + 1.0, GOAL)):
        q, qd = curve(coefficients, t)
        np.testing.assert_allclose(q, end, atol=1e-13)
        np.testing.assert_allclose(qd, 0.0, atol=1e-12)


def test_velocity_is_the_slope() -> None:
    coefficients = np.random.default_rng(1).normal(size=(3, SHAPES))
    for t in np.linspace(0.05, 0.75, 15):
        slope = (curve(coefficients, t + 1e-6)[0] - curve(coefficients, t - 1e-6)[0]) / 2e-6
        np.testing.assert_allclose(curve(coefficients, t)[1], slope, atol=1e-6)


def test_shape_functions_are_those_of_the_curve() -> None:
    s = np.linspace(0.0, 1.0, 21)
    values, slopes, curvatures = shape_functions(s)
    assert values.shape == (SHAPES, 21)
    np.testing.assert_allclose(values[0, 10], 1.0)  # half way
    for k in range(SHAPES):
        unit = np.zeros((3, SHAPES))
        unit[1, k] = 1.0
        bends = [
            [found - plain for found, plain in zip(curve(unit, t), curve(0 * unit, t), strict=True)]
            for t in s * DURATION
        ]
        np.testing.assert_allclose(values[k], [q[1] for q, _ in bends], atol=1e-12)
        np.testing.assert_allclose(slopes[k], [DURATION * qd[1] for _, qd in bends], atol=1e-10)
    ahead, behind = shape_functions(s[1:-1] + 1e-5)[1], shape_functions(s[1:-1] - 1e-5)[1]
    np.testing.assert_allclose(curvatures[:, 1:-1], (ahead - behind) / 2e-5, atol=1e-3)
