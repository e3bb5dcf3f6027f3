"""The files of a training run: settings, metrics, agents, and the checkpoint from which it resumes."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
import yaml

from agents.files import whole_file, write_json, write_text
from agents.policies.agent import FORMAT, Agent
from agents.policies.files import describe_layout, layout_of, save_agent
from agents.provenance import machine, versions
from agents.training.learning_curves import Row, merit
from agents.training.ppo import SegmentedPPO, agent_tensors
from agents.training.recipe import TrainingConfig

RL_DISTRIBUTIONS = ("stable-baselines3", "torch", "safetensors")


@dataclass
class RunState:
    """All state that crosses the boundary of a segment, besides networks and optimizer."""

    steps: int = 0  # control steps so far
    seconds: float = 0.0  # of training so far, without evaluations
    rows: list[Row] = field(default_factory=list)  # of metrics.csv so far


def write_origin(folder: Path, config: TrainingConfig, command: str) -> None:
    """Write what a run starts from: its settings, and the command, versions and machine.

    Raises:
        ValueError: if the folder is not empty.
    """
    if folder.exists() and any(folder.iterdir()):
        raise ValueError(f"{folder} is not empty: choose another --out, or continue the run there: --resume {folder}")
    origin = {"command": command, "seed": config.seed}
    write_json(folder / "run.json", {**origin, "versions": versions(RL_DISTRIBUTIONS), "machine": machine()})
    write_text(folder / "config.yaml", yaml.safe_dump(config.model_dump(mode="json"), sort_keys=False))


def make_agent(model: SegmentedPPO, seconds: float, scores: dict[str, float] | None = None) -> Agent:
    """The agent that a model has become after ``seconds`` of training, with its scores if they are known."""
    config = model.config
    document = {
        "format": FORMAT,
        "env": config.env,
        "env_config": config.env_config,
        **describe_layout(layout_of(config.env, config.env_config)),
        "activation": config.activation,
        "hidden": list(config.hidden),
        "training": {
            "config": config.model_dump(mode="json"),
            "seed": config.seed,
            "steps": model.num_timesteps,
            "seconds": round(seconds, 1),
        },
        "versions": versions(RL_DISTRIBUTIONS),
    }
    return Agent({**document, **({} if scores is None else {"scores": scores})}, agent_tensors(model.policy))


def save_checkpoint(folder: Path, model: SegmentedPPO, state: RunState, agent: Agent) -> None:
    """Write the agent of the last row of ``state``, the metrics and, last, the checkpoint that ends the segment."""
    save_agent(agent, folder / "last.safetensors")
    *before, row = map(merit, state.rows)
    if row > max(before, default=(-1.0, 0.0)):
        save_agent(agent, folder / "best.safetensors")
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(state.rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(state.rows)
    write_text(folder / "metrics.csv", text.getvalue())
    content = {
        "policy": model.policy.state_dict(),
        "optimizer": model.policy.optimizer.state_dict(),
        "steps": state.steps,
        "updates": model._n_updates,
        "seconds": state.seconds,
        "rows": state.rows,
    }
    with whole_file(folder / "checkpoint.pt") as draft:
        torch.save(content, draft)


def load_checkpoint(folder: Path, model: SegmentedPPO) -> RunState:
    """Restore networks and optimizer from a run's checkpoint, if there is one; the state of the run."""
    path = folder / "checkpoint.pt"
    if not path.exists():
        return RunState()
    content: dict[str, Any] = torch.load(path, weights_only=True)
    model.policy.load_state_dict(content["policy"])
    model.policy.optimizer.load_state_dict(content["optimizer"])
    model.num_timesteps, model._n_updates = content["steps"], content["updates"]
    return RunState(content["steps"], content["seconds"], content["rows"])
