"""`agents.training.algorithms.optimizers`: what Muon does to a network, and runs with it; needs the `rl` extra."""

from __future__ import annotations

from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("stable_baselines3", reason='needs pip install "planarm[rl]"')

import torch
from test_amortise import SMALL as MOVES
from test_training import CLONED, SMALL

from agents.training.algorithms.optimizers import MUON_RATE, optimizer_of
from agents.training.recipe import TrainingConfig
from agents.training.run import TrainingRun, Watcher

pytestmark = pytest.mark.rl

RECIPES = {
    "DAgger and PPO": {**SMALL, **CLONED, "total_steps": 800, "checkpoint_steps": 400},
    "amortised": MOVES,
}


class Networks(torch.nn.Module):
    """Networks with the names of a policy of PPO."""

    def __init__(self) -> None:
        super().__init__()
        torch.manual_seed(0)
        self.mlp_extractor = torch.nn.Sequential(torch.nn.Linear(6, 8), torch.nn.Tanh(), torch.nn.Linear(8, 4))
        self.action_net = torch.nn.Linear(4, 4)
        self.log_std = torch.nn.Parameter(torch.zeros(4))

    def loss(self) -> torch.Tensor:
        inputs, wanted = torch.randn(400, 10, generator=torch.Generator().manual_seed(1)).split([6, 4], 1)
        actions: torch.Tensor = self.action_net(self.mlp_extractor(inputs))
        return ((actions - self.log_std - wanted - 3.0 * inputs[:, :4]) ** 2).mean()


def stepped(name: Any, **options: Any) -> tuple[dict[str, torch.Tensor], dict[str, torch.Tensor]]:
    """Parameters before and after a step."""
    networks = Networks()
    before = {key: value.clone() for key, value in networks.state_dict().items()}
    optimizer = optimizer_of(name, networks, 1e-3, **options)
    networks.loss().backward()
    optimizer.step()
    return before, networks.state_dict()


def test_muon_steps_along_the_orthogonal_factor_of_the_gradient_and_leaves_the_rest_to_adam() -> None:
    before, after = stepped("muon")
    _, by_adam = stepped("adam")
    networks = Networks()
    networks.loss().backward()
    for name, parameter in networks.named_parameters():
        if name.startswith("mlp_extractor") and parameter.ndim == 2:
            left, _, right = torch.linalg.svd(parameter.grad, full_matrices=False)
            exact = -left @ right * max(1.0, parameter.shape[0] / parameter.shape[1]) ** 0.5
            step = (after[name] - before[name]) / (MUON_RATE * 1e-3)
            # Five iterations of Newton and Schulz leave singular values of about 0.7 to 1.2.
            assert float(torch.nn.functional.cosine_similarity(step.flatten(), exact.flatten(), dim=0)) > 0.95
            assert 0.7 < float(step.norm() / exact.norm()) < 1.2
        else:
            assert torch.equal(after[name], by_adam[name])


@pytest.mark.parametrize("name", ["adam", "muon"])
def test_the_last_layer_can_have_a_rate_of_its_own(name: Any) -> None:
    before, after = stepped(name, last_rate=1e-2)
    _, usual = stepped(name)
    for key in after:
        ratio = (after[key] - before[key]).abs().max() / (usual[key] - before[key]).abs().max()
        assert float(ratio) == pytest.approx(10.0 if key.startswith("action_net") else 1.0, rel=1e-3)


def test_an_optimizer_goes_on_from_its_state() -> None:
    one, other = Networks(), Networks()
    first = optimizer_of("muon", one, 1e-3)
    for _ in range(3):
        one.loss().backward()
        first.step()
        first.zero_grad()
    other.load_state_dict(one.state_dict())
    second = optimizer_of("muon", other, 0.5)
    second.load_state_dict(deepcopy(first.state_dict()))
    for networks, optimizer in ((one, first), (other, second)):
        networks.loss().backward()
        optimizer.step()
    for here, there in zip(one.parameters(), other.parameters(), strict=True):
        assert torch.equal(here, there)


@pytest.mark.parametrize("recipe", RECIPES)
def test_a_run_with_muon_is_stopped_anywhere_and_ends_with_the_same_weights(recipe: str, tmp_path: Path) -> None:
    config = TrainingConfig.parse({**RECIPES[recipe], "optimizer": "muon"}, "training setting")
    assert TrainingRun.begin(tmp_path / "whole", config, "test").train()
    run = TrainingRun.begin(tmp_path / "stopped", config, "test")
    lines: list[str] = []
    for word in ("DAgger", "amortising", "success"):  # in the fit, after it, and at a checkpoint
        before = len(lines)
        run.train(Watcher(begin=lines.append, stop=lambda: any(word in line for line in lines[before:])))  # noqa: B023
        run = TrainingRun.resume(tmp_path / "stopped")
    run.train()
    one, other = ((tmp_path / name / "last.safetensors").read_bytes() for name in ("whole", "stopped"))
    assert one == other
    plain = TrainingConfig.parse(RECIPES[recipe], "training setting")
    assert TrainingRun.begin(tmp_path / "adam", plain, "test").train()
    assert (tmp_path / "adam" / "last.safetensors").read_bytes() != one
