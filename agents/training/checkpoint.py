"""What a training run writes after each segment: metrics, agents, and the checkpoint from which it resumes."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from dataclasses import dataclass, field
from operator import attrgetter
from pathlib import Path
from shutil import copyfile
from typing import Any

import torch

from agents.policies.agent import FORMAT, SQUASHED_FORMAT, Agent
from agents.policies.files import describe_layout, layout_of, save_agent
from agents.provenance import versions
from agents.training.algorithms.segmented import Segmented
from agents.training.folder import RL_DISTRIBUTIONS
from agents.training.learning_curves import Row, merit
from agents.training.recipe import OffPolicyConfig, PPOConfig
from agents.training.replay import load_replay, save_replay
from agents.training.state_file import State, damaged, read_state, write_state
from planners.files import whole_file, write_text

CHECKPOINT, PREVIOUS = "checkpoint.pt", "previous.pt"
"""The last checkpoint of a run, and the one before it, from which it goes on if the last is deleted."""


@dataclass
class RunState:
    """All state that crosses the boundary of a segment, besides networks and optimizer."""

    steps: int = 0  # control steps so far
    seconds: float = 0.0  # of training so far, without evaluations
    rows: list[Row] = field(default_factory=list)  # of metrics.csv so far


def make_agent(model: Segmented, seconds: float, scores: dict[str, float] | None = None) -> Agent:
    """The agent that a model has become after ``seconds`` of training, with its scores if they are known."""
    config = model.config
    document = {
        "format": SQUASHED_FORMAT if model.squashed else FORMAT,
        "env": config.env_id,
        "env_config": config.env_config,
        **describe_layout(layout_of(config.env_id, config.env_config)),
        "activation": config.activation,
        "hidden": list(config.hidden),
        **({"forecasts": "apf"} if isinstance(config, PPOConfig) and config.forecasts else {}),
        "training": {
            "config": config.model_dump(mode="json"),
            "seed": config.seed,
            "steps": model.num_timesteps,
            "seconds": round(seconds, 1),
        },
        "versions": versions(RL_DISTRIBUTIONS),
    }
    return Agent({**document, **({} if scores is None else {"scores": scores})}, model.actor_tensors())


def save_checkpoint(folder: Path, run: str, model: Segmented, state: RunState, agent: Agent) -> None:
    """Write the agent of the last row of ``state``, the metrics and, last, the checkpoint that ends the segment.

    ``run`` is the identity of the run. The checkpoint before it is kept as ``previous.pt``.
    """
    save_agent(agent, folder / "last.safetensors")
    *before, row = map(merit, state.rows)
    if row > max(before, default=(-1.0, 0.0)):
        save_agent(agent, folder / "best.safetensors")
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(state.rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(state.rows)
    write_text(folder / "metrics.csv", text.getvalue())
    content: State = {
        "parameters": model.get_parameters(),
        "variables": {name: getattr(model, name).detach().clone() for name in _variables(model)},
        "steps": state.steps,
        "updates": model._n_updates,
        "seconds": state.seconds,
        "rows": state.rows,
    }
    buffer = getattr(model, "replay_buffer", None)
    if buffer is not None:
        content["replay_sha256"] = save_replay(_replay(folder, state.steps), buffer)
    if (folder / CHECKPOINT).exists():
        with whole_file(folder / PREVIOUS) as draft:
            copyfile(folder / CHECKPOINT, draft)
    write_state(folder / CHECKPOINT, run, content)
    kept = {_replay(folder, int(row["steps"])) for row in state.rows[-2:]}
    for path in folder.glob("replay-*.npz"):
        if path not in kept:
            path.unlink()


def load_checkpoint(folder: Path, run: str, model: Segmented) -> RunState:
    """Restore the networks, their optimizers and the replay buffer from a run's checkpoint, if there is one.

    Returns:
        The state of the run.

    Raises:
        ValueError: if the checkpoint is damaged or of a run with another identity than ``run``. No code in it is run.
    """
    path = next((folder / name for name in (CHECKPOINT, PREVIOUS) if (folder / name).exists()), None)
    if path is None:
        return RunState()
    content = read_state(path, run, model.device)
    try:
        networks = list(model._get_torch_save_params()[0])
        parameters = {name: dict(content["parameters"][name]) for name in networks}
        model.set_parameters(parameters, exact_match=True, device=model.device)
        _check_optimizers(map(attrgetter, networks), model)
        for name in _variables(model):
            variable, value = getattr(model, name).data, content["variables"][name]
            if value.shape != variable.shape:
                raise ValueError(f"{name} has another shape")
            variable.copy_(value)
        model.num_timesteps, model._n_updates = int(content["steps"]), int(content["updates"])
        state = RunState(model.num_timesteps, float(content["seconds"]), _checked(content["rows"]))
        if state.steps != state.rows[-1]["steps"]:
            raise ValueError("steps without a row")
        digest = str(content["replay_sha256"]) if isinstance(model.config, OffPolicyConfig) else ""
    except Exception as error:  # a damaged file can fail in any way
        raise damaged(path, error) from None
    if digest:
        load_replay(_replay(folder, state.steps), digest, model.replay_buffer)
    return state


def _replay(folder: Path, steps: int) -> Path:
    """The file of the replay buffer that belongs to a checkpoint."""
    return folder / f"replay-{steps}.npz"


def _check_optimizers(getters: Iterable[attrgetter[Any]], model: Segmented) -> None:
    """Raise a ValueError unless the state of each optimizer has the shapes of its parameters."""
    for optimizer in (part for get in getters if isinstance(part := get(model), torch.optim.Optimizer)):
        for parameter, state in optimizer.state.items():
            if any(value.ndim and value.shape != parameter.shape for value in state.values()):
                raise ValueError("an optimizer of other networks")


def _checked(rows: Any) -> list[Row]:
    """Rows of metrics.csv from a checkpoint; another kind of content is a TypeError, KeyError or ValueError."""
    for row in rows:
        merit(row)
        if row.keys() != rows[0].keys() or not all(isinstance(name, str) for name in row):
            raise ValueError("rows of different columns")
        for name, value in row.items():
            if name != "expert" and not isinstance(value, (int, float)):
                raise TypeError(f"{name} is no number")
    return [dict(row) for row in rows]


def _variables(model: Segmented) -> list[str]:
    """Names of the tensors of a model outside its networks: the entropy weight of SAC."""
    return list(model._get_torch_save_params()[1])
