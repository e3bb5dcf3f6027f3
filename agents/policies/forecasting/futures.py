"""From the features of a disc to the ways it may go: a mixture of paths, by a small network."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from agents.policies.forecasting.features import FEATURES, disc_features
from envs.obstacle_dodge.paths import FARTHEST, LAG, NEAREST
from planners.apf.safety import STEP
from planners.typing import Array

KNOT_STEPS = (2, 4, 7, 10, 14, 18, 24, 30, 38, 48, 62)
"""Instants for which the network says where a disc will be, in `planners.apf.safety.STEP`; straight in between."""

KNOTS = len(KNOT_STEPS)

PATHS = 4
"""How many paths it gives, with their probabilities."""

SPREAD = 0.5
"""Unit of the network's outputs, as a speed, m/s: they are what is added to going on as the disc wants."""

OUTPUTS = PATHS * (2 * KNOTS + 1)


class Network(NamedTuple):
    """Weights of the network, float64: features less their mean, over their spread, and two layers of rectifiers.

    Attributes:
        mean, spread: of the features, ``(FEATURES,)``.
        weight0, bias0, weight1, bias1, weight2, bias2: of the layers, weights ``(outputs, inputs)``; the last gives
            displacements ``(PATHS, KNOTS, 2)`` along and across, then ``PATHS`` logits.
    """

    mean: Array
    spread: Array
    weight0: Array
    bias0: Array
    weight1: Array
    bias1: Array
    weight2: Array
    bias2: Array


def knot_table(steps: int) -> Array:
    """For each instant, `STEP` apart and `STEP` from now: the knot it lies before, and its share of the way there.

    Returns:
        ``(steps, 2)``; before the first knot the way begins at the disc.

    Raises:
        ValueError: if the last knot lies before the last instant.
    """
    if steps > KNOT_STEPS[-1]:
        raise ValueError(f"a forecast reaches {KNOT_STEPS[-1] * STEP:g} s ahead, not {steps * STEP:g} s")
    table = np.empty((steps, 2))
    for step in range(1, steps + 1):
        knot = int(np.searchsorted(KNOT_STEPS, step))
        before = KNOT_STEPS[knot - 1] if knot > 0 else 0
        table[step - 1] = knot, (step - before) / (KNOT_STEPS[knot] - before)
    return table


@njit(cache=True, nogil=True)
def going_on(track: Any, t: float) -> tuple[float, float]:
    """Where a disc is in t seconds that goes on wanting what it wants, ``(x, y)``, m."""
    lag = LAG * (1.0 - math.exp(-t / LAG))
    x = track.place[0] + t * track.wanted[0] - lag * (track.wanted[0] - track.velocity[0])
    y = track.place[1] + t * track.wanted[1] - lag * (track.wanted[1] - track.velocity[1])
    return x, y


@njit(cache=True, nogil=True)
def expect(track: Any, move: Any, network: Network, table: Array, places: Array, weights: Array) -> None:
    """The paths that a disc may take.

    Args:
        track: of the disc.
        move: the arm's straight move.
        network: the forecaster's.
        table: from `knot_table`.
        places: filled in, ``(PATHS, steps, 2)``, m from the base.
        weights: probabilities, filled in, ``(PATHS,)``.
    """
    features = np.empty(FEATURES)
    c, s = disc_features(track, move, features)
    said = _run(network, features)
    logits = said[2 * PATHS * KNOTS :]
    weights[:] = np.exp(logits - logits.max())
    weights /= weights.sum()
    for step in range(places.shape[1]):
        knot, share = int(table[step, 0]), table[step, 1]
        on_x, on_y = going_on(track, STEP * (step + 1))
        for path in range(PATHS):
            along, across = _displacement(said, path, knot, share)
            x, y = on_x + c * along - s * across, on_y + s * along + c * across
            away = math.hypot(x, y)
            scale = min(FARTHEST, max(NEAREST, away)) / max(away, 1e-9)
            places[path, step, 0], places[path, step, 1] = scale * x, scale * y


@njit(cache=True, nogil=True)
def _run(network: Network, features: Array) -> Array:
    """The network's outputs, ``(OUTPUTS,)``; row by row, so that the batch size does not change a bit."""
    values = (features - network.mean) / network.spread
    values = np.maximum(np.dot(network.weight0, values) + network.bias0, 0.0)
    values = np.maximum(np.dot(network.weight1, values) + network.bias1, 0.0)
    outputs: Array = np.dot(network.weight2, values) + network.bias2
    return outputs


@njit(cache=True, nogil=True)
def _displacement(said: Array, path: int, knot: int, share: float) -> tuple[float, float]:
    """What is added to going on as before, along and across, m."""
    along = across = 0.0
    for k, part in ((knot - 1, 1.0 - share), (knot, share)):
        if k >= 0:
            unit = SPREAD * STEP * KNOT_STEPS[k] * part
            along += unit * said[2 * (path * KNOTS + k)]
            across += unit * said[2 * (path * KNOTS + k) + 1]
    return along, across
