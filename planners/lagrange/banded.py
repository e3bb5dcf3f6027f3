"""Symmetric positive definite banded systems, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit

from planners.typing import Array


@njit(cache=True, nogil=True)
def factorise(matrix: Array) -> bool:
    """Banded Cholesky factorisation in place; False if the matrix is not positive definite.

    Row i of ``matrix`` ``(size, band + 1)`` holds columns ``i - band ... i``, the diagonal last.
    """
    size, width = matrix.shape
    band = width - 1
    for i in range(size):
        for j in range(max(0, i - band), i):
            total = matrix[i, j - i + band]
            for k in range(max(0, i - band, j - band), j):
                total -= matrix[i, k - i + band] * matrix[j, k - j + band]
            matrix[i, j - i + band] = total / matrix[j, band]
        total = matrix[i, band]
        for k in range(max(0, i - band), i):
            total -= matrix[i, k - i + band] ** 2
        if not total > 0.0:
            return False
        matrix[i, band] = np.sqrt(total)
    return True


@njit(cache=True, nogil=True)
def substitute(factor: Array, rhs: Array) -> None:
    """Solve with a factor of `factorise`; ``rhs`` ``(size,)`` becomes the solution."""
    size, width = factor.shape
    band = width - 1
    for i in range(size):
        for j in range(max(0, i - band), i):
            rhs[i] -= factor[i, j - i + band] * rhs[j]
        rhs[i] /= factor[i, band]
    for i in range(size - 1, -1, -1):
        rhs[i] /= factor[i, band]
        for j in range(max(0, i - band), i):
            rhs[j] -= factor[i, j - i + band] * rhs[i]
