"""Fits the network of the forecaster to paths of discs, drawn as the environment draws them; no arm moves meanwhile.

The network gives a mixture of paths, and what is maximised is its likelihood, with distances that may be larger the
further ahead they are. So the paths part where a disc may turn or not, instead of meeting in the mean of both.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from gymnasium.utils import seeding
from numba import njit
from numpy.typing import NDArray

from agents.policies.forecasting.features import FEATURES, disc_features
from agents.policies.forecasting.forecaster import Forecaster, describe_network
from agents.policies.forecasting.futures import KNOT_STEPS, KNOTS, OUTPUTS, PATHS, SPREAD, going_on
from agents.policies.forecasting.policy import aimed_move
from agents.policies.forecasting.track import MOVE, PERIOD, follow_disc, new_tracks
from envs.obstacle_dodge.env import ObstacleDodge
from envs.obstacle_dodge.paths import PATH_STEP
from envs.obstacle_dodge.starts import DodgeStarts, ObstacleDodgeOptions
from planners.apf.safety import STEP
from planners.typing import Array
from tools.forecaster.config import ForecastConfig

FIRST_EPISODE = 3_000_000
"""Seed of the first path of training seed 0, apart from those that choose or judge; the next begins a million on."""

WATCHED = 5.0
"""Time of an episode up to which forecasts are learnt, s."""

BLUR, BLUR_GROWTH = 0.02, 0.08
"""Distance from a path that counts as one unit, m, and by how much more a second ahead, m/s."""

SHARPNESS = 3.0
"""Fall of the likelihood's logarithm with a distance of one unit."""

LEAST_SPREAD = 1e-3
"""Of a feature."""


@dataclass(frozen=True)
class Samples:
    """What was seen of discs, and where they went.

    Attributes:
        features: ``(samples, FEATURES)``.
        displacements: from going on as before, along and across, at the knots, ``(samples, KNOTS, 2)``, m.
    """

    features: NDArray[np.float32]
    displacements: NDArray[np.float32]


def draw_samples(config: ForecastConfig, seed: int) -> Samples:
    """Discs of random episodes, watched at random instants.

    Args:
        config: how many.
        seed: of training.
    """
    task = ObstacleDodge.make({}, 1)
    limits = task.motion_problem(np.zeros(task.layout.size, dtype=np.float32)).joint_limits
    length = round((WATCHED + STEP * KNOT_STEPS[-1]) / PATH_STEP) + 1
    starts, options = DodgeStarts(task.arm, limits, length, 1), ObstacleDodgeOptions.parse({}, "option")
    first = FIRST_EPISODE + 1_000_000 * seed
    moves, paths = np.zeros(config.episodes, MOVE), np.empty((config.episodes, length, 2))
    for i in range(config.episodes):
        episode = starts.draw(seeding.np_random(first + i)[0], options)
        moves[i] = aimed_move(task.arm, limits, episode.start, episode.goal + task.arm.base_array)
        paths[i] = episode.path[:, 0]
    steps = round(WATCHED / PERIOD)
    instants = np.sort(np.random.default_rng(first).integers(0, steps, (config.episodes, config.samples)), axis=1)
    count = config.episodes * config.samples
    features, displacements = np.empty((count, FEATURES)), np.empty((count, KNOTS, 2))
    _watch(moves, paths, instants, new_tracks(config.episodes), np.array(KNOT_STEPS), features, displacements)
    return Samples(features.astype(np.float32), displacements.astype(np.float32))


@njit(cache=True, nogil=True)
def _watch(
    moves: Any,
    paths: Array,
    instants: NDArray[np.int64],
    tracks: Any,
    knots: NDArray[np.int64],
    features: Array,
    displacements: Array,
) -> None:
    """Fill in features and displacements, one row an instant."""
    row = 0
    for episode in range(moves.shape[0]):
        track, path, sample = tracks[episode], paths[episode], 0
        for step in range(instants[episode, -1] + 1):
            now = 2 * step
            since = max(now, 1)  # at the start a disc shows the velocity of its first step
            follow_disc(track, moves[episode], path[now], (path[since] - path[since - 1]) / PATH_STEP)
            while sample < instants.shape[1] and instants[episode, sample] == step:
                c, s = disc_features(track, moves[episode], features[row])
                for k in range(knots.shape[0]):
                    on_x, on_y = going_on(track, STEP * knots[k])
                    there = path[now + round(STEP / PATH_STEP) * knots[k]]
                    dx, dy = there[0] - on_x, there[1] - on_y
                    displacements[row, k, 0], displacements[row, k, 1] = c * dx + s * dy, c * dy - s * dx
                row, sample = row + 1, sample + 1


class Mixture(torch.nn.Module):  # type: ignore[misc]
    """The network, in torch.

    Args:
        mean, spread: of the features.
        hidden: width of its layers.
    """

    def __init__(self, mean: Array, spread: Array, hidden: int) -> None:
        super().__init__()
        self.mean, self.spread = torch.as_tensor(mean), torch.as_tensor(spread)
        sizes = (FEATURES, hidden, hidden, OUTPUTS)
        self.layers = torch.nn.ModuleList(torch.nn.Linear(*pair) for pair in pairwise(sizes))
        unit = SPREAD * STEP * torch.tensor(KNOT_STEPS, dtype=torch.float32)
        self.unit = unit[:, None]
        with torch.no_grad():
            self.layers[-1].weight *= 0.5

    def forward(self, features: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Displacements ``(samples, PATHS, KNOTS, 2)``, m, and logarithms of probabilities ``(samples, PATHS)``."""
        values = (features - self.mean) / self.spread
        for layer in self.layers[:-1]:
            values = torch.relu(layer(values))
        said = self.layers[-1](values)
        paths = said[:, :-PATHS].reshape(-1, PATHS, KNOTS, 2) * self.unit
        return paths, torch.log_softmax(said[:, -PATHS:], dim=1)

    def tensors(self) -> dict[str, NDArray[Any]]:
        """Weights by the names of `agents.policies.forecasting.futures.Network`."""
        weights = {"mean": self.mean.numpy(), "spread": self.spread.numpy()}
        for i, layer in enumerate(self.layers):
            weights[f"weight{i}"] = layer.weight.detach().numpy().copy()
            weights[f"bias{i}"] = layer.bias.detach().numpy().copy()
        return weights


def distances(paths: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
    """Of forecast paths ``(samples, PATHS, KNOTS, 2)`` from the true one, ``(samples, PATHS, KNOTS)``, m."""
    return torch.sqrt(((paths - truth[:, None]) ** 2).sum(-1) + 1e-5)


def surprise(paths: torch.Tensor, logs: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
    """Minus the mean logarithm of the mixture's likelihood."""
    blur = BLUR + BLUR_GROWTH * STEP * torch.tensor(KNOT_STEPS, dtype=torch.float32)
    fall = SHARPNESS * (distances(paths, truth) / blur).mean(-1)
    return -torch.logsumexp(logs - fall, dim=1).mean()


def fit(
    config: ForecastConfig, samples: Samples, seed: int, progress: Callable[[str], object] = lambda line: None
) -> Forecaster:
    """Train a forecaster.

    Args:
        config: of the training.
        samples: from `draw_samples`; a twelfth is not learnt from, and judges.
        seed: of the first weights and the order.
        progress: called with a line after each epoch.
    """
    torch.manual_seed(seed)
    generator = np.random.default_rng(seed)
    held_out = len(samples.features) // 12
    learnt = samples.features[held_out:]
    mean, spread = learnt.mean(axis=0), learnt.std(axis=0) + LEAST_SPREAD
    network = Mixture(mean, spread, config.hidden)
    features, truth = torch.from_numpy(samples.features), torch.from_numpy(samples.displacements)
    optimizer = torch.optim.Adam(network.parameters(), lr=config.learning_rate)
    batches = len(learnt) // config.batch_size
    errors: dict[str, float] = {}
    for epoch in range(config.epochs):
        order = held_out + generator.permutation(len(learnt))
        for batch in range(batches):
            optimizer.param_groups[0]["lr"] = config.learning_rate * (
                1.0 - (epoch * batches + batch) / (config.epochs * batches)
            )
            rows = torch.from_numpy(order[batch * config.batch_size : (batch + 1) * config.batch_size])
            paths, logs = network(features[rows])
            loss = surprise(paths, logs, truth[rows])
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
        errors = judge(network, features[:held_out], truth[:held_out])
        told = ", ".join(f"{name.replace('_', ' ')} {value:.3f}" for name, value in errors.items())
        progress(f"epoch {epoch + 1} of {config.epochs}: {told}")
    document = {"training": {"config": config.model_dump(), "seed": seed, "samples": len(learnt), "errors": errors}}
    tensors = network.tensors()
    return Forecaster({**describe_network(tensors), **document}, tensors)


def judge(network: Mixture, features: torch.Tensor, truth: torch.Tensor) -> dict[str, float]:
    """How good forecasts are: their surprise, and mean distances in m.

    Of going on as before, of the likeliest path and of the best one from the true path.
    """
    with torch.no_grad():
        paths, logs = network(features)
        apart = distances(paths, truth).mean(-1)
        return {
            "surprise": float(surprise(paths, logs, truth)),
            "going_on": float(truth.norm(dim=-1).mean()),
            "likeliest": float(apart.gather(1, logs.argmax(dim=1)[:, None]).mean()),
            "best": float(apart.min(dim=1).values.mean()),
        }
