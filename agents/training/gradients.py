"""Gradients of the loss of a minibatch, chunk by chunk on several threads."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from types import TracebackType
from typing import Self

import torch

CHUNK = 1024  # samples of which the activations stay in the cache of a core
SMALLEST = 256  # samples of the smallest minibatch that is cut

Loss = Callable[[slice], torch.Tensor]  # mean loss of some samples of a minibatch


def chunks(samples: int) -> list[slice]:
    """The parts of a minibatch: an even number of at most `CHUNK` samples each, or one of less than `SMALLEST`."""
    parts = 1 if samples < SMALLEST else 2 * -(-samples // (2 * CHUNK))
    ends = [samples * part // parts for part in range(parts + 1)]
    return [slice(start, end) for start, end in pairwise(ends)]


class Gradients:
    """Computes gradients on several threads; their number does not change the result by a bit.

    Minibatches are cut into the same chunks for any number of threads, and the gradients of the chunks are added in
    their order. A waiting thread sleeps instead of spinning as PyTorch's own threads do, so that other programs on the
    same cores slow training down only by their share.

    Args:
        threads: how many; PyTorch works on one thread within each.
        whole: whether minibatches stay whole, which is best on a GPU.
    """

    def __init__(self, threads: int = 1, *, whole: bool = False) -> None:
        self._whole = whole
        self._pool: ThreadPoolExecutor | None = None
        if threads > 1 and not whole:
            self._pool = ThreadPoolExecutor(threads, "gradients", torch.set_num_threads, (1,))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: TracebackType | None) -> None:
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)

    def backward(self, parameters: Iterable[torch.Tensor], samples: int, loss: Loss) -> float:
        """Set the gradients of parameters to those of the mean loss of a minibatch.

        Args:
            parameters: those that learn; one on which the loss does not depend has no gradient afterwards.
            samples: of the minibatch.
            loss: mean loss of a part of it; called on several threads at once.

        Returns:
            The mean loss of the minibatch.
        """
        learning = [parameter for parameter in parameters if parameter.requires_grad]

        def part(where: slice) -> tuple[float, tuple[torch.Tensor | None, ...]]:
            value = loss(where) * ((where.stop - where.start) / samples)
            return float(value.detach()), torch.autograd.grad(value, learning, allow_unused=True)

        parts = [slice(0, samples)] if self._whole else chunks(samples)
        answers = list(map(part, parts) if self._pool is None else self._pool.map(part, parts))
        for parameter, (first, *others) in zip(learning, zip(*(each for _, each in answers), strict=True), strict=True):
            gradient = first
            for other in others:
                gradient = gradient + other if gradient is not None and other is not None else None
            parameter.grad = None if gradient is None else gradient.contiguous()
        return sum(value for value, _ in answers)
