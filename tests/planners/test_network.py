"""The compiled network of agents: right to float32, and a row's result is its own."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from planners.control.network import Network, tanh


def network(activation: str, sizes: tuple[int, ...] = (7, 33, 30, 3)) -> tuple[Network, list[tuple[np.ndarray, ...]]]:
    """A network of weights at random, and its layers; two of the five elements of an observation are magnified."""
    generator = np.random.default_rng(1)
    layers = [
        (generator.standard_normal((outputs, inputs)) / np.sqrt(inputs), generator.standard_normal(outputs))
        for inputs, outputs in pairwise(sizes)
    ]
    fine = {"fine.index": np.array([4, 0]), "fine.gain": np.array([3.0, 9.0])}
    return Network.pack(fine, layers, activation), layers


@pytest.mark.parametrize("activation", ["relu", "tanh"])
def test_the_outputs_are_those_of_the_layers(activation: str) -> None:
    packed, layers = network(activation)
    observations = np.random.default_rng(2).standard_normal((6, 5)).astype(np.float32)
    values = np.concatenate([observations, np.tanh(observations[:, [4, 0]] * [3.0, 9.0])], axis=1, dtype=np.float64)
    for weight, bias in layers[:-1]:
        values = values @ weight.T + bias
        values = np.maximum(values, 0.0) if activation == "relu" else np.tanh(values)
    np.testing.assert_allclose(packed.run(observations), values @ layers[-1][0].T + layers[-1][1], atol=2e-5)


@pytest.mark.parametrize("activation", ["relu", "tanh"])
def test_a_row_does_not_depend_on_the_others(activation: str) -> None:
    packed, _ = network(activation)
    observations = np.random.default_rng(3).standard_normal((37, 5)).astype(np.float32)
    together = packed.run(observations)
    for rows in (1, 2, 5, 8):
        for first in range(0, 37, rows):
            np.testing.assert_array_equal(
                packed.run(observations[first : first + rows]), together[first : first + rows]
            )


def test_tanh_is_right_to_some_units_in_the_last_place() -> None:
    values = np.linspace(-12.0, 12.0, 200_001, dtype=np.float32)
    np.testing.assert_allclose(tanh(values), np.tanh(values.astype(np.float64)), rtol=1e-6)
    assert np.abs(tanh(np.array([[-50.0, 50.0], [np.inf, -np.inf]]))).tolist() == [[1.0, 1.0], [1.0, 1.0]]
