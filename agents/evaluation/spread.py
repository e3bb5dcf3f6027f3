"""A benchmark in pieces, spread over the workers of a Ray cluster.

A piece is what one machine does at once: one policy on the episodes of one batch, the bounds of a few episodes, or the
replay of one. An episode depends on its seed alone, and a batch holds the same episodes as on one machine, so that the
pieces join to the same numbers to the bit, whichever worker did which.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from agents.cluster import Place

BOUNDS = 8  # episodes whose bounds are one piece
RETRIES = 10  # how often a piece whose worker dies is done again
_LOOK = 0.2  # s between two looks at Ctrl-C

Kind = Literal["episodes", "bounds", "replay"]


@dataclass(frozen=True)
class Piece:
    """A part of a benchmark that any worker can do."""

    kind: Kind
    task: str  # its title
    policy: str  # its name; empty for bounds
    seeds: tuple[int, ...]


@dataclass(frozen=True)
class Order:
    """What every worker of a benchmark knows."""

    config: str  # as JSON
    allow_code: bool
    place: Place
    modules: tuple[str, ...]  # that register tasks of the user's own


@dataclass
class Workers:
    """Workers of a cluster that this process is connected to; `start` gives them pieces, `results` collects.

    Attributes:
        ray: the module.
        order: of what benchmark the pieces are.
        do: does a piece in a worker.
    """

    ray: Any
    order: Order
    do: Callable[[Order, Piece], Any]
    _begun: dict[Piece, Any] = field(default_factory=dict)

    def start(self, pieces: Sequence[Piece]) -> None:
        """Give pieces to the cluster, in the order in which they are needed."""
        remote = self.ray.remote(num_cpus=1, max_retries=RETRIES)(self.do)
        for piece in pieces:
            if piece not in self._begun:
                self._begun[piece] = remote.remote(self.order, piece)

    def results(self, pieces: Sequence[Piece], progress: Callable[[int], object]) -> list[Any]:
        """What the pieces gave, in their order; what one raises is raised here.

        ``progress`` is called with the number of episodes of each piece when it is done, and with 0 now and then.
        """
        self.start(pieces)
        waiting = {self._begun[piece]: len(piece.seeds) for piece in pieces}
        while waiting:
            done, _ = self.ray.wait(list(waiting), timeout=_LOOK)
            for reference in done:
                self._value(reference)
            progress(sum(waiting.pop(reference) for reference in done))
        return [self._value(self._begun.pop(piece)) for piece in pieces]

    def _value(self, reference: Any) -> Any:
        try:
            return self.ray.get(reference)
        except self.ray.exceptions.RayTaskError as error:
            raise error.cause from None
        except self.ray.exceptions.RayError as error:
            raise ValueError(f"the cluster has lost a part of the benchmark: {str(error)[:300]}") from None
