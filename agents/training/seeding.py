"""Seeds of a training run: every segment seeds all generators anew, so that a resumed run continues bit for bit."""

from __future__ import annotations

import random
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

TRAINING_SEEDS = 2**31  # environments are trained on seeds in [2**31, 2**32); evaluations use lower ones


def seed_everything(seed: int, segment: int) -> None:
    """Seed every generator of this process for a segment of a run; the warm start is segment 0."""
    state = _segment_state(seed, segment)
    random.seed(int(state[0]))
    np.random.seed(int(state[1]))  # noqa: NPY002  # Stable-Baselines3 draws minibatches from the global generator
    torch.manual_seed(int(state[2]))


def env_seed(seed: int, segment: int) -> int:
    """Seed of a segment's first environment; each further environment has the next seed."""
    return TRAINING_SEEDS + int(_segment_state(seed, segment)[3]) % (2**31 - 2**20)


def _segment_state(seed: int, segment: int) -> NDArray[Any]:
    return np.random.SeedSequence([seed, segment]).generate_state(4)
