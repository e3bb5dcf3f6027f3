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

PATHS: dict[str, Any] = {
    "env": "ObstacleDodge-v0",
    "forecasts": {"episodes": 8, "updates": 40, "batch_size": 32},
    "total_steps": 64,
    "checkpoint_steps": 32,
    "num_envs": 2,
    "rollout_steps": 8,
    "batch_size": 16,
    "hidden": [8, 8],
    "evaluation_episodes": 2,
    "baselines": [],
}
# A recipe, what the lines about its fit begin with, and a step between its first and its second checkpoint.
RECIPES = {
    "DAgger": ({**SMALL, **CLONED, "total_steps": 800, "checkpoint_steps": 400}, "DAgger", 600),
    "amortised": (MOVES, "amortising", 48),
    "forecasts": (PATHS, "forecasts", 48),
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
def test_a_run_with_muon_is_stopped_in_its_fit_and_in_ppo_and_ends_with_the_same_weights(
    recipe: str, tmp_path: Path
) -> None:
    given, fit, step = RECIPES[recipe]
    config = TrainingConfig.parse({**given, "optimizer": "muon"}, "training setting")
    assert TrainingRun.begin(tmp_path / "whole", config, "test").train()
    run = TrainingRun.begin(tmp_path / "stopped", config, "test")
    lines: list[str] = []
    steps = [0]
    assert not run.train(Watcher(begin=lines.append, stop=lambda: bool(lines) and lines[-1].startswith(fit)))
    run = TrainingRun.resume(tmp_path / "stopped")
    assert not run.train(Watcher(step=steps.append, stop=lambda: steps[-1] >= step))
    assert (tmp_path / "stopped" / "checkpoint.pt").exists()
    assert TrainingRun.resume(tmp_path / "stopped").train()
    one, other = ((tmp_path / name / "last.safetensors").read_bytes() for name in ("whole", "stopped"))
    assert one == other


@pytest.mark.parametrize("recipe", RECIPES)
def test_every_fit_before_ppo_takes_the_optimizer(recipe: str, tmp_path: Path) -> None:
    for name in ("adam", "muon"):
        given = {**RECIPES[recipe][0], "total_steps": 0, "optimizer": name}
        assert TrainingRun.begin(tmp_path / name, TrainingConfig.parse(given, "training setting"), "test").train()
    one, other = ((tmp_path / name / "last.safetensors").read_bytes() for name in ("adam", "muon"))
    assert one != other
