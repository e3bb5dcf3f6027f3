"""Optimizers of networks: Adam, or Muon for the weights of hidden layers."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import torch

from agents.training.recipe import OptimizerName

MUON_RATE = 10.0
"""Learning rate of the weights that Muon updates, over that of the other parameters."""

WEIGHT_DECAY = 0.03
"""Share of the weights, times the learning rate, that Muon takes off in a step: without, they grow over tens of
thousands of steps until the fit of MinTorqueMove-v0 fails."""


class Muon(torch.optim.Optimizer):  # type: ignore[misc]
    """Muon for the weights of hidden layers, Adam for all other parameters.

    Muon makes the singular values of each step of a weight matrix equal (K. Jordan, "Muon: an optimizer for hidden
    layers in neural networks", 2024). Its learning rate is `MUON_RATE` times that of the group.

    Args:
        weights: of the hidden layers, matrices.
        others: groups of the other parameters.
        learning_rate: of the weights.
        eps: of Adam.
    """

    def __init__(
        self, weights: Iterable[torch.Tensor], others: list[dict[str, Any]], learning_rate: float, eps: float
    ) -> None:
        self._muon = torch.optim.Muon(weights, lr=learning_rate, weight_decay=WEIGHT_DECAY)
        self._adam = torch.optim.Adam(others, lr=learning_rate, eps=eps, fused=True)
        super().__init__([*self._muon.param_groups, *self._adam.param_groups], {})
        self._share()

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Go on from a state."""
        super().load_state_dict(state_dict)
        self._share()

    def step(self, closure: None = None) -> None:
        """Take a step along the gradients."""
        weights = self.param_groups[0]
        rate = weights["lr"]
        weights["lr"] = MUON_RATE * rate
        self._muon.step()
        weights["lr"] = rate
        self._adam.step()

    def _share(self) -> None:
        """Let both optimizers work on the groups and the state of this one."""
        self._muon.param_groups, self._adam.param_groups = self.param_groups[:1], self.param_groups[1:]
        self._muon.state = self._adam.state = self.state


def optimizer_of(
    name: OptimizerName, policy: Any, learning_rate: float, *, last_rate: float | None = None, eps: float = 1e-8
) -> torch.optim.Optimizer:
    """An optimizer of all networks of a policy of PPO.

    Args:
        name: of the optimizer.
        policy: whose parameters learn.
        learning_rate: of all parameters.
        last_rate: that of the actor's last layer, if it is another one.
        eps: of Adam.
    """
    last = list(policy.action_net.parameters())
    weights = [tensor for tensor in policy.mlp_extractor.parameters() if tensor.ndim == 2] if name == "muon" else []
    known = {id(tensor) for tensor in [*last, *weights]}
    others = [
        {"params": [tensor for tensor in policy.parameters() if id(tensor) not in known], "lr": learning_rate},
        {"params": last, "lr": last_rate or learning_rate},
    ]
    if name == "muon":
        return Muon(weights, others, learning_rate, eps)
    return torch.optim.Adam(others, eps=eps, fused=True)
