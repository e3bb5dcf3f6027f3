"""Gradient steps on random minibatches, as all fits before PPO take them."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import torch
from numpy.typing import NDArray

from agents.training.recipe import Amortisation, WarmStart

Minibatch = NDArray[np.int64]  # indices of samples


def gradient_steps(
    optimizer: torch.optim.Optimizer,
    loss: Callable[[Minibatch], torch.Tensor],
    samples: int,
    settings: WarmStart | Amortisation,
    generator: np.random.Generator,
    *,
    first: int = 0,
    rate: Callable[[int], float] = lambda update: 1.0,
    max_norm: float | None = None,
) -> Iterator[float]:
    """Take the gradient steps one by one; yields the loss of each.

    Args:
        optimizer: of the parameters; its first learning rates are those that ``rate`` scales.
        loss: of a minibatch, which ``generator`` draws from so many ``samples``.
        settings: number of updates, and size of a minibatch.
        first: number of the first update, of those that are left.
        rate: factor on the learning rates, by the number of the update.
        max_norm: a longer gradient is scaled down to this norm.
    """
    parameters = [parameter for group in optimizer.param_groups for parameter in group["params"]]
    for update in range(first, settings.updates):
        for group in optimizer.param_groups:
            group["lr"] = group.setdefault("initial_lr", group["lr"]) * rate(update)
        value = loss(generator.integers(samples, size=settings.batch_size))
        optimizer.zero_grad()
        value.backward()
        if max_norm is not None:
            torch.nn.utils.clip_grad_norm_(parameters, max_norm)
        optimizer.step()
        yield float(value.detach())
