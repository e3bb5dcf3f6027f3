"""Lagrange interpolation in barycentric form on Chebyshev-Lobatto nodes, with exact derivative matrices.

After J.-P. Berrut and L. N. Trefethen, "Barycentric Lagrange Interpolation", SIAM Review 46 (2004). Everything lives on
the unit interval ``[0, 1]``.
"""

from __future__ import annotations

import numpy as np

from planners.typing import Array


def lobatto_nodes(degree: int) -> Array:
    """Chebyshev-Lobatto nodes ``(1 - cos(i pi / degree)) / 2`` in rising order, ``(degree + 1,)``."""
    nodes: Array = np.sin(np.arange(degree + 1) * np.pi / (2 * degree)) ** 2
    return nodes


def lobatto_quadrature(degree: int) -> Array:
    """Clenshaw-Curtis weights on the nodes: exact integrals over ``[0, 1]`` of the interpolant, ``(degree + 1,)``."""
    order = np.arange(0, degree + 1, 2)
    # Integral over [0, 1] of the Chebyshev polynomial of even order; odd ones have none.
    moments = 1.0 / (1.0 - order**2)
    cosines = np.cos(np.outer(np.arange(degree + 1), order) * np.pi / degree)
    share = np.where((order == 0) | (order == degree), 1.0, 2.0) / degree
    weights = np.asarray(cosines @ (moments * share), dtype=float)
    weights[[0, -1]] /= 2.0
    return weights


def barycentric_weights(degree: int) -> Array:
    """Barycentric weights of the nodes up to a common factor: alternating signs, half at the ends."""
    weights = np.where(np.arange(degree + 1) % 2 == 0, 1.0, -1.0)
    weights[[0, -1]] /= 2.0
    return weights


def differentiation_matrices(degree: int, orders: int) -> Array:
    """Matrices that turn values at the nodes into those of the interpolant's derivatives.

    By Welfert's recursion with negative row sums on the diagonal, "Generation of Pseudospectral Differentiation
    Matrices I", SIAM J. Numer. Anal. 34 (1997).

    Args:
        degree: of the interpolant.
        orders: highest derivative.

    Returns:
        ``(orders + 1, degree + 1, degree + 1)``; order 0 is the identity.
    """
    count = degree + 1
    i, j = np.meshgrid(np.arange(count), np.arange(count), indexing="ij")
    # Differences of nodes by the addition theorem: no cancellation where nodes are close.
    difference = np.sin((i + j) * np.pi / (2 * degree)) * np.sin((i - j) * np.pi / (2 * degree))
    difference[np.diag_indices(count)] = 1.0
    weights = barycentric_weights(degree)
    quotient = weights[None, :] / weights[:, None]
    matrices = np.empty((orders + 1, count, count))
    matrices[0] = np.eye(count)
    for order in range(1, orders + 1):
        previous = matrices[order - 1]
        matrix = order / difference * (quotient * np.diag(previous)[:, None] - previous)
        matrix[np.diag_indices(count)] = 0.0
        matrix[np.diag_indices(count)] = -matrix.sum(axis=1)
        matrices[order] = matrix
    return matrices


def evaluation_matrix(degree: int, s: Array) -> Array:
    """Matrix that turns values at the nodes into those of the interpolant at ``s`` in [0, 1], ``(points, degree + 1)``.

    The Lagrange polynomials ``l_i`` of eq 9 of the minimal-torque paper, one column each, in barycentric form.
    """
    difference = s[:, None] - lobatto_nodes(degree)
    at_node = difference == 0.0
    difference[at_node] = 1.0
    terms = barycentric_weights(degree) / difference
    terms[at_node.any(axis=1)] = 0.0
    terms[at_node] = 1.0
    matrix: Array = terms / terms.sum(axis=1, keepdims=True)
    return matrix
