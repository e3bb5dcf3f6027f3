"""Errors of Lagrange interpolation (eq 10 and 11) and Runge's phenomenon, which eq 7 is to avoid.

(10)  E(t) = theta^(N)(eps) / N! omega(t)
(11)  omega(t) = product over k of (t - t_k),   eps in [t_1, t_N]
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
from numpy.polynomial import Polynomial
from scipy.interpolate import BarycentricInterpolator

from agents.papers.report import Columns, Record
from planners.lagrange.interpolation import lobatto_nodes
from planners.lagrange.paper import PUBLISHED_TIMES, chebyshev_nodes
from planners.typing import Array

COUNTS = (5, 9, 13, 17, 21)
QUINTIC = Polynomial([0.0, 0.0, 0.0, 10.0, -15.0, 6.0])
"""The move of 1 rad from rest to rest in 1 s; its fifth derivative is constant, so eq 10 is exact with five nodes."""
_T = np.linspace(0.0, 1.0, 4001)


def runge(t: Array) -> Array:
    """C. Runge's function, moved to [0, 1] s: 1 / (1 + 25 s^2) with s from -1 to 1."""
    value: Array = 1.0 / (1.0 + 25.0 * (2.0 * t - 1.0) ** 2)
    return value


def with_ends(count: int) -> Array:
    """Eq 7 with its first and last node moved to 0 and 1, where eq 13 gives the angles."""
    nodes = chebyshev_nodes(count)
    nodes[[0, -1]] = 0.0, 1.0
    return nodes


FAMILIES: dict[str, Callable[[int], Array]] = {
    "equidistant": lambda count: np.linspace(0.0, 1.0, count),
    "eq 7": chebyshev_nodes,
    "eq 7, ends at 0 and 1": with_ends,
    "Lobatto": lambda count: lobatto_nodes(count - 1),
}
"""Node times on [0, 1] s, by their number."""


def node_polynomial(nodes: Array, t: Array) -> Array:
    """omega(t) of eq 11, s^N."""
    product: Array = np.prod(t[:, None] - nodes, axis=1)
    return product


def interpolated(function: Callable[[Array], Array], nodes: Array, t: Array) -> Array:
    """Eq 8 and 9: the interpolant of a function at the nodes."""
    return np.asarray(BarycentricInterpolator(nodes, function(nodes))(t), dtype=float)


def node_records() -> Iterator[Record]:
    """For nodes of every family and number, and for Table 2: the size of omega, and errors of interpolation, rad."""
    for count in COUNTS:
        for name, family in FAMILIES.items():
            yield _record(name, family(count))
        if count == len(PUBLISHED_TIMES):
            yield _record("Table 2", np.array(PUBLISHED_TIMES))


def _record(name: str, nodes: Array) -> Record:
    count, bound = len(nodes), float(np.abs(node_polynomial(nodes, _T)).max())
    errors = [float(np.abs(interpolated(function, nodes, _T) - function(_T)).max()) for function in (runge, QUINTIC)]
    derivative = QUINTIC.deriv(count)
    return {
        "nodes": name,
        "count": count,
        "omega": bound,  # largest |omega| on [0, 1] s, s^N
        "runge_error": errors[0],
        "quintic_error": errors[1],
        "quintic_bound": bound * float(np.abs(derivative(_T)).max()) / math.factorial(count),  # eq 10
    }


NODE_CAPTION = (
    "Largest values on 0 to 1 s: of omega (eq 11, s^N), and of the error (rad) of interpolating Runge's function and "
    "the quintic move of 1 rad; by eq 10: the largest N-th derivative of the quintic / N! times the largest omega."
)
NODE_COLUMNS: Columns = {
    "N": "{count}",
    "nodes": "{nodes}",
    "omega": "{omega:.2e}",
    "Runge's function": "{runge_error:.4f}",
    "quintic": lambda row: f"{row['quintic_error']:.4f}",
    "by eq 10": lambda row: f"{row['quintic_bound']:.4f}",
}
