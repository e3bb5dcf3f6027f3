"""Agents as files: weights in safetensors, and a JSON beside them that says what they were trained on."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from contextlib import closing
from importlib import resources
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load, save

import envs
from agents.environments import check_names, portable
from agents.policies.agent import FORMATS, Agent
from envs.observation import Layout
from envs.obstacle_dodge.forecasts import INPUTS as FORECAST_INPUTS
from envs.settings import refuse_unknown
from planners.checks import brief
from planners.documents import read_document
from planners.files import write_bytes, write_json

_REQUIRED = ("format", "sha256", "env", "env_config", "layout_hash", "activation", "hidden")
_REPLACED = "replaced"  # key of the JSON of the weights that are about to be replaced
_ATTEMPTS = 20
_MOST_LOG_STD = 80.0  # its exponential is a float32
_NORMAL_RANGES = {"normal.mean": (-1e9, 1e9), "normal.std": (1e-9, 1e9), "normal.clip": (1e-9, 1e9)}
MOST_BYTES, MOST_JSON_BYTES = 1 << 28, 1 << 20
"""Largest sizes of the files of an agent, bytes: of its weights, and of its JSON."""
_SHIPPED = resources.files("agents.policies").joinpath("trained")


def shipped_agents() -> list[str]:
    """Ids of the environments for which planarm ships a trained agent."""
    return [name for name in _shipped() if "." not in name]


def shipped_variants(env_id: str) -> list[str]:
    """Names of the other agents that planarm ships for an environment, each trained for harder episodes."""
    return [name.removeprefix(f"{env_id}.") for name in _shipped() if name.startswith(f"{env_id}.")]


def load_agent(source: str | Path, variant: str | None = None) -> Agent:
    """A trained agent.

    Args:
        source: the id of an environment, for the agent shipped with planarm; or the path of a run folder, for its best
            agent, or of a .safetensors file with its JSON beside it. A `Path` is never an id.
        variant: with the id of an environment: the name of the agent that is shipped for harder episodes, one of
            `shipped_variants`; None for the agent of the default episodes.

    Raises:
        ValueError: if there is none, its files are damaged, or the environment's observations have changed since it
            was trained.
    """
    path = _find(source) if variant is None else _shipped_file(str(source), variant)
    for _ in range(_ATTEMPTS):  # more than one only while another process replaces the agent
        content = _weights(path)
        document = _of_weights(read_document(path.with_suffix(".json"), MOST_JSON_BYTES), content)
        if not isinstance(document, dict) or document.get("sha256") == _hash(content):
            break
    try:
        tensors = load(content)
    except (SafetensorError, KeyError, TypeError, ValueError, OverflowError, MemoryError) as error:
        raise ValueError(f"cannot read {path}: {type(error).__name__}: {str(error)[:300]}") from None
    missing = [name for name in _REQUIRED if not isinstance(document, dict) or name not in document]
    if missing:
        raise ValueError(f"{path.with_suffix('.json')} lacks {', '.join(missing)}")
    if not isinstance(document["format"], int) or document["format"] not in FORMATS:
        raise ValueError(
            f"{path} has format {brief(document['format'])}; this version of planarm reads {FORMATS[0]} to "
            f"{FORMATS[-1]}"
        )
    if document["sha256"] != _hash(content):
        raise ValueError(f"{path} and {path.with_suffix('.json').name} beside it do not belong together; restore both")
    try:
        layout = layout_of(str(document["env"]), document["env_config"])
        agent = check_agent(Agent(document, tensors, shipped=path.parent == Path(str(_SHIPPED))))
    except ValueError as error:
        raise ValueError(f"cannot read {path}: {error}") from None
    _check_layout(path, document, layout)
    size = FORECAST_INPUTS if agent.forecasts else layout.size
    if agent.observation_size != size:
        raise ValueError(f"{path} takes observations of {agent.observation_size} elements; {agent.env_id} gives {size}")
    return agent


def save_agent(agent: Agent, path: str | Path) -> None:
    """Write an agent's weights to ``path`` (.safetensors) and its JSON beside it.

    An agent that is there already can be loaded at any moment, until the new one can: the JSON holds that of the
    replaced weights too until they are replaced.

    Raises:
        ValueError: for a file of another suffix, and for weights with which no agent can act.
    """
    path = Path(path)
    if path.suffix != ".safetensors":
        raise ValueError(f"cannot write {path}: the name of an agent's file ends in .safetensors")
    check_agent(agent)
    content = save({name: np.ascontiguousarray(tensor) for name, tensor in agent.tensors.items()})
    beside = path.with_suffix(".json")
    document = {**agent.document, "env_config": portable(agent.env_config), "sha256": _hash(content)}
    try:
        replaced = _of_weights(json.loads(beside.read_text(encoding="utf-8")), path.read_bytes())
    except (OSError, ValueError, RecursionError):
        replaced = None
    kept = {name: replaced[name] for name in replaced if name != _REPLACED} if isinstance(replaced, dict) else None
    write_json(beside, document if kept is None else {**document, _REPLACED: kept})
    write_bytes(path, content)
    if kept is not None:
        write_json(beside, document)


def check_agent(agent: Agent) -> Agent:
    """An agent as it is; a ValueError for weights with which it cannot act, as after training that diverged."""
    for name, tensor in agent.tensors.items():
        if not np.isfinite(tensor).all():
            raise ValueError(f"{name} of an agent holds values that are not finite")
    if "log_std" in agent.tensors and (np.abs(agent.tensors["log_std"]) > _MOST_LOG_STD).any():
        raise ValueError(f"log_std of an agent must lie within {_MOST_LOG_STD} of 0")
    for name, (least, most) in _NORMAL_RANGES.items() if agent.normalized else ():
        values = agent.tensors[name].astype(np.float64)
        if not ((values >= least) & (values <= most)).all():
            raise ValueError(f"{name} of an agent must lie from {least:g} to {most:g}")
    return agent


def _weights(path: Path) -> bytes:
    """The file of an agent's weights; a ValueError if it cannot be read or is too large."""
    if path.exists() and not path.is_file():
        raise ValueError(f"cannot read {path}: it is no file")
    try:
        with path.open("rb") as file:
            content = file.read(MOST_BYTES + 1)
    except FileNotFoundError:
        raise ValueError(f"{path.parent} has no {path.name}, so it holds no agent") from None
    except OSError as error:
        raise ValueError(f"cannot read {path}: {error.strerror}") from None
    if len(content) > MOST_BYTES:
        raise ValueError(f"cannot read {path}: it is larger than {MOST_BYTES >> 20} MiB")
    return content


def _of_weights(document: Any, content: bytes) -> Any:
    """The JSON that belongs to some weights: that of the replaced ones inside it, or else as it is."""
    replaced = document.get(_REPLACED) if isinstance(document, dict) else None
    return replaced if isinstance(replaced, dict) and replaced.get("sha256") == _hash(content) else document


def _hash(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def describe_layout(layout: Layout) -> dict[str, Any]:
    """The part of an agent's JSON about the observations that it was trained on."""
    entries = [
        {"name": entry.name, "size": entry.size, "scale": entry.scale, "bound": entry.bound, "unit": entry.unit}
        for entry in layout.entries
    ]
    return {"layout": entries, "layout_hash": hashlib.sha256(json.dumps(entries).encode()).hexdigest()}


def layout_of(env_id: str, env_config: Mapping[str, Any]) -> Layout:
    """The layout of an environment's observations.

    Raises:
        ValueError: if there is no such environment, or it refuses the settings.
    """
    refuse_unknown([env_id], envs.env_ids(), "environment")
    if not isinstance(env_config, Mapping):
        raise ValueError(f"settings of {env_id} must be names and values, not {env_config!r:.80}")
    check_names(env_id, env_config, {}, takes_options=False)
    with closing(gym.make(env_id, **env_config)) as env:
        layout: Layout = env.unwrapped.task.layout  # type: ignore[attr-defined]
        return layout


def _shipped() -> list[str]:
    names = (file.name for file in _SHIPPED.iterdir())
    return sorted(name.removesuffix(".safetensors") for name in names if name.endswith(".safetensors"))


def _shipped_file(env_id: str, variant: str | None) -> Path:
    """The file of the weights of a shipped agent."""
    refuse_unknown([env_id], shipped_agents(), "agent (the path of one ends in .safetensors)")
    if variant is not None:
        refuse_unknown([variant], shipped_variants(env_id), f"agent of {env_id} for harder episodes")
    return Path(
        str(_SHIPPED.joinpath(f"{env_id}.safetensors" if variant is None else f"{env_id}.{variant}.safetensors"))
    )


def _find(source: str | Path) -> Path:
    """The file of an agent's weights."""
    path = Path(source)
    if isinstance(source, Path) or source not in shipped_agents():
        if path.is_dir():
            return path / "best.safetensors"
        if path.suffix == ".safetensors":
            if not path.exists():
                raise ValueError(f"no file {path}")
            return path
        if path.exists():
            raise ValueError(f"{path} is no agent: the file of one ends in .safetensors")
        if len(path.parts) > 1:
            raise ValueError(f"no folder {path}")
    return _shipped_file(str(source), None)


def _check_layout(path: Path, document: Mapping[str, Any], layout: Layout) -> None:
    """Raise a ValueError if the environment's observations have changed since the agent was trained."""
    now = describe_layout(layout)
    if now["layout_hash"] == document["layout_hash"]:
        return
    listed = document.get("layout")
    before = [entry for entry in listed if isinstance(entry, dict) and "name" in entry] if type(listed) is list else []
    changed = [
        str(entry["name"]) for entry in [*before, *now["layout"]] if entry not in before or entry not in now["layout"]
    ]
    raise ValueError(
        f"{path} was trained on other observations of {document['env']} than this version of planarm gives (changed: "
        f"{', '.join(dict.fromkeys(changed)) or 'their order'}); train it anew, or use the version named in its JSON"
    )
