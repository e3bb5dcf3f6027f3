"""Two steps that every extended Kalman filter takes, compiled; see D. Simon, "Optimal State Estimation" (2006).

The filters are `planners.control.observer` and `planners.excavator.payload_filter`.
"""

from __future__ import annotations

import numpy as np

from planners.compiled.calls import private
from planners.typing import Array


@private
def move_covariance(f: Array, cov: Array) -> None:
    """Replace ``cov`` by ``f cov f^T`` (section 5.2); ``f`` is sparse, both are ``(size, size)``."""
    size = cov.shape[0]
    half = np.zeros((size, size))
    for k in range(size):
        for j in range(size):
            if f[k, j] != 0.0:
                for m in range(size):
                    half[k, m] += f[k, j] * cov[j, m]
    cov[:, :] = 0.0
    for k in range(size):
        for j in range(size):
            if f[k, j] != 0.0:
                for m in range(size):
                    cov[m, k] += half[m, j] * f[k, j]


@private
def correct_by(measured: float, place: int, variance: float, x: Array, cov: Array) -> float:
    """Correct state vector and covariance by one measured number (section 6.1).

    Args:
        measured: the number.
        place: of the same number in ``x`` ``(size,)``.
        variance: of its noise.
        x: the state vector.
        cov: its covariance, ``(size, size)``.

    Returns:
        The squared normalised innovation.
    """
    size = x.shape[0]
    spread, innovation = cov[place, place] + variance, measured - x[place]
    for k in range(size):  # the row of the number itself comes last: all others need it as it was
        row = size - 1 if k == place else k if k < size - 1 else place
        gain = cov[row, place] / spread
        x[row] += gain * innovation
        for m in range(size):
            cov[row, m] -= gain * cov[place, m]
    squared: float = innovation * innovation / spread
    return squared
