"""The state of a run before its first checkpoint, in a file of its own."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import torch

from agents.training.state_file import State, damaged, read_state, write_state


@dataclass
class Stage:
    """Where the warm start of a run keeps its state, so that it can be continued bit for bit.

    Attributes:
        path: of the file, which is there from the first part that is saved until the run's first checkpoint; None
            keeps nothing.
        report: called with a line about what is done; says whether to continue.
        seconds: that the warm start took before this process went on with it.
    """

    path: Path | None = None
    run: str = ""
    report: Callable[[str], bool] = lambda line: True
    seconds: float = 0.0
    _parts: State = field(default_factory=dict)
    _begun: float = field(default_factory=perf_counter)

    def load(self, name: str) -> State | None:
        """The state of a part as it was saved, or None.

        Raises:
            ValueError: if the file is damaged. No code in it is run.
        """
        if self.path is not None and self.path.exists() and not self._parts:
            content = read_state(self.path, self.run)
            try:
                self.seconds, self._parts = float(content["seconds"]), dict(content["parts"])
            except Exception as error:  # a damaged file can fail in any way
                raise damaged(self.path, error) from None
        state: State | None = self._parts.get(name)
        return state

    def save(self, name: str, state: State) -> None:
        """Keep the state of a part, in the types that torch loads without running code."""
        self._parts[name] = state
        if self.path is not None:
            write_state(self.path, self.run, {"seconds": self.elapsed(), "parts": self._parts})

    def elapsed(self) -> float:
        """Seconds that the warm start has taken, over all processes."""
        return self.seconds + perf_counter() - self._begun

    def finish(self) -> None:
        """Remove the file."""
        if self.path is not None:
            self.path.unlink(missing_ok=True)


def state_of(policy: Any, optimizer: torch.optim.Optimizer, generator: np.random.Generator) -> State:
    """The state of a fit: copies of the networks and the optimizer, and of the generator of minibatches."""
    return {
        "policy": deepcopy(policy.state_dict()),
        "optimizer": deepcopy(optimizer.state_dict()),
        "generator": generator.bit_generator.state,
    }
