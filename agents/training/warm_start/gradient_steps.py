"""Gradient steps on random minibatches, as all fits before PPO take them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray

from agents.training.gradients import Gradients
from agents.training.recipe import Amortisation, Forecasts, WarmStart

Minibatch = NDArray[np.int64]  # indices of samples


def gradient_steps(
    optimizer: torch.optim.Optimizer,
    loss: Callable[[Minibatch], torch.Tensor],
    samples: int,
    settings: WarmStart | Amortisation | Forecasts,
    generator: np.random.Generator,
    *,
    threads: int,
    first: int = 0,
    rate: Callable[[int], float] = lambda update: 1.0,
    max_norm: float | None = None,
) -> Iterator[float]:
    """Take the gradient steps one by one; yields the loss of each.

    Args:
        optimizer: of the parameters; its first learning rates are those that ``rate`` scales.
        loss: mean loss of a part of a minibatch, which ``generator`` draws from so many ``samples``; called on several
            threads at once.
        settings: number of updates, and size of a minibatch.
        threads: on which the gradients are computed; their number does not change the result.
        first: number of the first update, of those that are left.
        rate: factor on the learning rates, by the number of the update.
        max_norm: a longer gradient is scaled down to this norm.
    """
    parameters = [parameter for group in optimizer.param_groups for parameter in group["params"]]
    with Gradients(threads) as gradients:
        for update in range(first, settings.updates):
            for group in optimizer.param_groups:
                group["lr"] = group.setdefault("initial_lr", group["lr"]) * rate(update)
            batch = generator.integers(samples, size=settings.batch_size)
            value = gradients.backward(parameters, len(batch), partial(_of_part, loss, batch))
            if max_norm is not None:
                torch.nn.utils.clip_grad_norm_(parameters, max_norm)
            optimizer.step()
            yield value


def _of_part(loss: Callable[[Minibatch], torch.Tensor], batch: Minibatch, where: slice) -> torch.Tensor:
    return loss(batch[where])
