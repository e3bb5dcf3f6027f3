"""A small network, compiled: it takes one thread, and a row's result does not depend on the rows beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planners.checks import require_shape
from planners.compiled.calls import private

Floats = NDArray[np.float32]
Tensors = Mapping[str, NDArray[Any]]

ACTIVATIONS = ("relu", "tanh")
"""Activation functions between the layers."""

_TANH_BOUND = np.float32(7.90531110763549805)  # beyond it tanh is 1 in float32
_ODD = tuple(
    np.float32(value)
    for value in (
        -2.76076847742355e-16,
        2.00018790482477e-13,
        -8.60467152213735e-11,
        5.12229709037114e-08,
        1.48572235717979e-05,
        6.37261928875436e-04,
        4.89352455891786e-03,
    )
)
_EVEN = tuple(
    np.float32(value)
    for value in (1.19825839466702e-06, 1.18534705686654e-04, 2.26843463243900e-03, 4.89352518554385e-03)
)
"""Coefficients of the rational approximation of tanh in Eigen's MathFunctionsImpl.h, highest power first."""


@dataclass(frozen=True, eq=False)
class Network:
    """Layers packed for `run`.

    Attributes:
        index: elements of the observation that are also given as tanh(gain * x), ``(fine,)``.
        gain: of each, ``(fine,)``.
        sizes: inputs of each layer and outputs of the last, ``(layers + 1,)``.
        weights: of all layers, each ``(inputs, outputs)``, one after the other.
        biases: of all layers, one after the other.
        relu: whether the activation is relu; tanh otherwise.
    """

    index: NDArray[np.int64]
    gain: Floats
    sizes: NDArray[np.int64]
    weights: Floats
    biases: Floats
    relu: bool

    @classmethod
    def pack(cls, tensors: Tensors, layers: Sequence[tuple[Any, Any]], activation: str) -> Network:
        """A network from its tensors.

        Args:
            tensors: ``fine.index`` and ``fine.gain``.
            layers: weight ``(outputs, inputs)`` and bias ``(outputs,)`` of each.
            activation: one of `ACTIVATIONS`.
        """
        weights = [np.ascontiguousarray(weight.T, dtype=np.float32).ravel() for weight, _ in layers]
        return cls(
            index=np.ascontiguousarray(tensors["fine.index"], dtype=np.int64),
            gain=np.ascontiguousarray(tensors["fine.gain"], dtype=np.float32),
            sizes=np.array([layers[0][0].shape[1], *(weight.shape[0] for weight, _ in layers)], dtype=np.int64),
            weights=np.concatenate(weights),
            biases=np.concatenate([np.ascontiguousarray(bias, dtype=np.float32) for _, bias in layers]),
            relu=activation == "relu",
        )

    def run(self, observations: Floats) -> Floats:
        """Outputs ``(rows, outputs)`` for observations ``(rows, size)``; ValueError for another size."""
        observations = np.ascontiguousarray(observations, dtype=np.float32)
        size = int(self.sizes[0]) - self.index.size
        require_shape("observations", observations, (len(observations), size))
        if self.index.size and not 0 <= self.index.min() <= self.index.max() < size:
            raise ValueError(f"fine.index {self.index} must be elements of the {size} of an observation")
        outputs = np.empty((len(observations), int(self.sizes[-1])), np.float32)
        _run(observations, self.index, self.gain, self.sizes, self.weights, self.biases, self.relu, outputs)
        return outputs


def tanh(values: Floats) -> Floats:
    """Hyperbolic tangents, as the network has them."""
    results = np.array(values, dtype=np.float32)
    _tanh(results.reshape(-1))
    return results


@njit(cache=True, nogil=True)
def _tanh(values: Floats) -> None:
    """Replace values ``(n,)`` by their hyperbolic tangents, to some units in the last place."""
    for i in range(values.size):
        x = min(max(values[i], -_TANH_BOUND), _TANH_BOUND)
        square = x * x
        odd = _ODD[0]
        for coefficient in _ODD[1:]:
            odd = odd * square + coefficient
        even = _EVEN[0]
        for coefficient in _EVEN[1:]:
            even = even * square + coefficient
        values[i] = x * odd / even


@njit(cache=True, nogil=True)
def _run(
    observations: Floats,
    index: NDArray[np.int64],
    gain: Floats,
    sizes: NDArray[np.int64],
    weights: Floats,
    biases: Floats,
    relu: bool,
    outputs: Floats,
) -> None:
    """Run the network row by row."""
    size, widest = observations.shape[1], sizes[0]
    for layer in range(1, sizes.size):
        widest = max(widest, sizes[layer])
    values, sums = np.empty(widest, np.float32), np.empty(widest, np.float32)
    active = np.empty(widest + 1, np.int64)
    for row in range(observations.shape[0]):
        for i in range(size):  # loops, as an assigned slice takes two seconds to compile
            values[i] = observations[row, i]
        for i in range(index.size):
            values[size + i] = gain[i] * observations[row, index[i]]
        _tanh(values[size : size + index.size])
        weight = bias = 0
        for layer in range(sizes.size - 1):
            inputs, width = sizes[layer], sizes[layer + 1]
            for i in range(width):
                sums[i] = biases[bias + i]
            _add_products(values[:inputs], weights[weight : weight + inputs * width], active, sums[:width])
            weight += inputs * width
            bias += width
            values, sums = sums, values
            if layer < sizes.size - 2:
                if relu:
                    for i in range(width):
                        values[i] = max(values[i], np.float32(0.0))
                else:
                    _tanh(values[:width])
        for i in range(outputs.shape[1]):
            outputs[row, i] = values[i]


@private
def _add_products(values: Floats, weights: Floats, active: NDArray[np.int64], sums: Floats) -> None:
    """Add values ``(inputs,)`` times weights ``(inputs * width,)`` to sums ``(width,)``, input by input in their order.

    Inputs that are zero, as behind relu about half are, cost nothing; ``active`` ``(inputs + 1,)`` is for the others.
    """
    width, count = sums.size, 0
    for k in range(values.size):
        active[count] = k
        count += values[k] != 0.0
    whole = count - count % 4
    for i in range(0, whole, 4):
        k0, k1, k2, k3 = active[i], active[i + 1], active[i + 2], active[i + 3]
        x0, x1, x2, x3 = values[k0], values[k1], values[k2], values[k3]
        w0, w1 = weights[k0 * width : (k0 + 1) * width], weights[k1 * width : (k1 + 1) * width]
        w2, w3 = weights[k2 * width : (k2 + 1) * width], weights[k3 * width : (k3 + 1) * width]
        for j in range(width):
            sums[j] = (((sums[j] + x0 * w0[j]) + x1 * w1[j]) + x2 * w2[j]) + x3 * w3[j]
    for i in range(whole, count):
        k = active[i]
        x, w = values[k], weights[k * width : (k + 1) * width]
        for j in range(width):
            sums[j] += x * w[j]
