"""The files of a training run: settings, metrics, agents, and the checkpoint from which it resumes."""

from __future__ import annotations

import csv
import io
import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
import yaml

from agents.policies.agent import FORMAT, SQUASHED_FORMAT, Agent
from agents.policies.files import describe_layout, layout_of, save_agent
from agents.provenance import machine, versions
from agents.training.algorithms.segmented import Segmented
from agents.training.devices import described
from agents.training.learning_curves import Row, merit
from agents.training.recipe import OffPolicyConfig, TrainingConfig
from agents.training.replay import load_replay, save_replay
from agents.training.warm_start.stage import damaged
from planners.files import whole_file, write_json, write_text

RL_DISTRIBUTIONS = ("stable-baselines3", "torch", "safetensors")


@dataclass
class RunState:
    """All state that crosses the boundary of a segment, besides networks and optimizer."""

    steps: int = 0  # control steps so far
    seconds: float = 0.0  # of training so far, without evaluations
    rows: list[Row] = field(default_factory=list)  # of metrics.csv so far


def write_origin(folder: Path, config: TrainingConfig, command: str) -> None:
    """Write what a run starts from: its settings, and the command, versions, machine and device.

    Raises:
        ValueError: if the folder is not empty.
    """
    if folder.exists() and any(folder.iterdir()):
        raise ValueError(f"{folder} is not empty: choose another --out, or continue the run there: --resume {folder}")
    settings = config.model_dump(mode="json")
    origin = {"command": command, "seed": config.seed, "versions": versions(RL_DISTRIBUTIONS)}
    write_json(folder / "run.json", {**origin, "machine": {**machine(), **described(config)}, "config": settings})
    write_text(folder / "config.yaml", yaml.safe_dump(settings, sort_keys=False))


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Keep other processes from training in a folder meanwhile, and remove what killed ones have left half-written.

    Raises:
        ValueError: if one is training there. The lock ends with its process, however that ends.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "lock").open("a+b") as file:
        try:
            if sys.platform == "win32":
                import msvcrt

                msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
            else:
                import fcntl

                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise ValueError(f"another process is training in {folder}: wait for it, or stop it first") from None
        for draft in folder.glob(".*.*.*"):
            if draft.suffix in (".pt", ".npz", ".csv", ".json", ".yaml", ".safetensors"):
                draft.unlink()
        yield


def check_origin(folder: Path, config: TrainingConfig) -> None:
    """Raise a ValueError if a run's settings are not those that it began with; device and threads may change."""
    try:
        began = json.loads((folder / "run.json").read_text(encoding="utf-8")).get("config")
    except (OSError, ValueError, AttributeError) as error:
        raise ValueError(f"cannot read {folder / 'run.json'}: {error}") from None
    now = config.model_dump(mode="json")
    changed = [name for name in now if began is not None and now[name] != began.get(name)]
    if changed := [name for name in changed if name not in ("device", "threads")]:
        raise ValueError(
            f"{folder / 'config.yaml'} was edited since the run began ({', '.join(changed)}): a run keeps its "
            "settings; restore them (run.json has them), or begin another run"
        )


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
        "training": {
            "config": config.model_dump(mode="json"),
            "seed": config.seed,
            "steps": model.num_timesteps,
            "seconds": round(seconds, 1),
        },
        "versions": versions(RL_DISTRIBUTIONS),
    }
    return Agent({**document, **({} if scores is None else {"scores": scores})}, model.actor_tensors())


def save_checkpoint(folder: Path, model: Segmented, state: RunState, agent: Agent) -> None:
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
        "parameters": model.get_parameters(),
        "variables": {name: getattr(model, name).detach().clone() for name in _variables(model)},
        "steps": state.steps,
        "updates": model._n_updates,
        "seconds": state.seconds,
        "rows": state.rows,
    }
    buffer = getattr(model, "replay_buffer", None)
    if buffer is not None:
        content["replay"] = f"replay-{state.steps}.npz"
        save_replay(folder / content["replay"], buffer)
    with whole_file(folder / "checkpoint.pt") as draft:
        torch.save(content, draft)
    for path in folder.glob("replay-*.npz"):
        if path.name != content.get("replay"):
            path.unlink()


def load_checkpoint(folder: Path, model: Segmented) -> RunState:
    """Restore the networks, their optimizers and the replay buffer from a run's checkpoint, if there is one.

    Returns:
        The state of the run.

    Raises:
        ValueError: if the checkpoint is damaged or of another run. No code in it is run.
    """
    path = folder / "checkpoint.pt"
    if not path.exists():
        return RunState()
    try:
        content: dict[str, Any] = torch.load(path, weights_only=True, map_location=model.device)
        parameters = {name: dict(content["parameters"][name]) for name in model._get_torch_save_params()[0]}
        model.set_parameters(parameters, exact_match=True, device=model.device)
        for name in _variables(model):
            getattr(model, name).data.copy_(content["variables"][name])
        model.num_timesteps, model._n_updates = int(content["steps"]), int(content["updates"])
        state = RunState(model.num_timesteps, float(content["seconds"]), _checked(content["rows"]))
    except OSError as error:
        raise ValueError(f"cannot read {path}: {error.strerror}") from None
    except Exception as error:  # a damaged file can fail in any way
        raise damaged(path, error) from None
    if isinstance(model.config, OffPolicyConfig):
        load_replay(folder / Path(str(content["replay"])).name, model.replay_buffer)
    return state


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
