"""Trained agents: a small network in NumPy, with the `predict` of an expert, kept as safetensors and JSON."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping
from contextlib import closing
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load, save

import envs  # noqa: F401  # registers the ids
from agents.evaluation.evaluate import known_env_ids
from agents.files import write_bytes, write_json
from envs.observation import Layout, Observation
from envs.settings import refuse_unknown

Actions = NDArray[np.float32]
Tensors = Mapping[str, NDArray[Any]]

FORMAT = 1
"""Of the files; a later one may hold what this version cannot read."""


def _relu(values: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.maximum(values, np.float32(0.0))


ACTIVATIONS: dict[str, Callable[[NDArray[np.float32]], NDArray[np.float32]]] = {"tanh": np.tanh, "relu": _relu}
"""Between the layers of an agent."""
ACTION_SETTINGS = ("control_mode",)
"""Settings of an environment that say what an action means, and leave the task as it is."""
_REQUIRED = ("env", "env_config", "layout_hash", "activation", "hidden")


@dataclass(frozen=True)
class Agent:
    """A policy that was learnt: the mean and the spread of a Gaussian over actions.

    The network sees an observation x and, for the elements ``fine.index``, tanh(gain * x) beside it. Its tensors are
    ``fine.index``, ``fine.gain``, ``log_std``, and ``weight`` (outputs, inputs) and ``bias`` of each layer, as in
    ``layer0.weight``.

    Attributes:
        document: what its JSON says: environment, layout, architecture, how it was trained, scores.
        tensors: weights, float32.
        generator: of the actions that are drawn when `predict` is asked for others than deterministic ones.
    """

    document: Mapping[str, Any]
    tensors: Tensors
    generator: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))

    def __post_init__(self) -> None:
        refuse_unknown([self.document["activation"]], ACTIVATIONS, "activation of an agent")
        _check_tensors(self.tensors, len(self.document["hidden"]) + 1)

    @property
    def env_id(self) -> str:
        """The environment it was trained on."""
        return str(self.document["env"])

    @property
    def env_config(self) -> dict[str, Any]:
        """The settings of that environment, those of its reward among them."""
        return dict(self.document["env_config"])

    @property
    def action_config(self) -> dict[str, Any]:
        """Those of the settings that say what its actions mean: it can work with no others."""
        return {name: value for name, value in self.env_config.items() if name in ACTION_SETTINGS}

    @property
    def observation_size(self) -> int:
        """Elements of an observation."""
        return int(self.tensors["layer0.weight"].shape[1] - self.tensors["fine.index"].size)

    def predict(
        self,
        observation: Observation,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = False,
    ) -> tuple[Actions, None]:
        """Actions for observations.

        Args:
            observation: ``(size,)`` or ``(num_envs, size)``.
            state: accepted for compatibility; an agent remembers nothing.
            episode_start: likewise.
            deterministic: the mean action, rather than one drawn around it.

        Returns:
            Actions in [-1, 1], ``(n,)`` or ``(num_envs, n)``, and None.

        Raises:
            ValueError: if the observation has the wrong size.
        """
        batch = np.atleast_2d(np.asarray(observation, dtype=np.float32))
        if batch.shape[1] != self.observation_size:
            raise ValueError(
                f"observations of {batch.shape[1]} elements; this agent of {self.env_id} takes {self.observation_size}"
            )
        actions = self._mean(batch)
        if not deterministic:
            actions += np.exp(self.tensors["log_std"]) * self.generator.standard_normal(actions.shape, dtype=np.float32)
        clipped: Actions = np.clip(actions, np.float32(-1.0), np.float32(1.0))
        return (clipped[0] if np.ndim(observation) == 1 else clipped), None

    def _mean(self, batch: Observation) -> Actions:
        """Unclipped mean actions ``(num_envs, n)``."""
        tensors, activation = self.tensors, ACTIVATIONS[self.document["activation"]]
        fine = np.tanh(batch[:, tensors["fine.index"]] * tensors["fine.gain"])
        values = np.concatenate([batch, fine], axis=1)
        last = len(self.document["hidden"])
        for layer in range(last):
            values = activation(values @ tensors[f"layer{layer}.weight"].T + tensors[f"layer{layer}.bias"])
        means: Actions = values @ tensors[f"layer{last}.weight"].T + tensors[f"layer{last}.bias"]
        return means


def shipped_agents() -> list[str]:
    """Environments for which a trained agent comes with planarm."""
    files = resources.files("agents.policies").joinpath("trained").iterdir()
    return sorted(file.name.removesuffix(".safetensors") for file in files if file.name.endswith(".safetensors"))


def load_agent(source: str | Path) -> Agent:
    """A trained agent.

    Args:
        source: the id of an environment, for the agent shipped with planarm; or the path of a run folder, for its best
            agent, or of a .safetensors file with its JSON beside it.

    Raises:
        ValueError: if there is none, its files are damaged, or the environment's observations have changed since it
            was trained.
    """
    path = _find(source)
    document, tensors = read_weights(path, _REQUIRED)
    _check_layout(path, document)
    return Agent(document, tensors)


def save_agent(agent: Agent, path: Path) -> None:
    """Write an agent's weights to ``path`` (.safetensors), and its JSON beside it; each whole or not at all."""
    write_weights(path, agent.document, agent.tensors)


def write_weights(path: Path, document: Mapping[str, Any], tensors: Tensors) -> None:
    """Write tensors to ``path`` (.safetensors), and a document beside it that says which they are."""
    content = save({name: np.ascontiguousarray(tensor) for name, tensor in tensors.items()})
    write_bytes(path, content)
    write_json(path.with_suffix(".json"), {**document, "sha256": hashlib.sha256(content).hexdigest()})


def describe_layout(layout: Layout) -> dict[str, Any]:
    """What an agent's JSON holds about the observations it was trained on."""
    entries = [
        {"name": entry.name, "size": entry.size, "scale": entry.scale, "bound": entry.bound, "unit": entry.unit}
        for entry in layout.entries
    ]
    return {"layout": entries, "layout_hash": hashlib.sha256(json.dumps(entries).encode()).hexdigest()}


def layout_of(env_id: str, env_config: Mapping[str, Any]) -> Layout:
    """What an observation of an environment holds.

    Raises:
        ValueError: if there is no such environment, or it refuses the settings.
    """
    refuse_unknown([env_id], known_env_ids(), "environment")
    with closing(gym.make(env_id, **env_config)) as env:
        layout: Layout = env.unwrapped.task.layout  # type: ignore[attr-defined]
        return layout


def _find(source: str | Path) -> Path:
    """The file of an agent's weights."""
    path, shipped = Path(source), shipped_agents()
    if str(source) not in shipped:
        if path.is_dir():
            return path / "best.safetensors"
        if path.suffix == ".safetensors":
            return path
    refuse_unknown([str(source)], shipped, "agent (the path of one ends in .safetensors)")
    return Path(str(resources.files("agents.policies").joinpath("trained", f"{source}.safetensors")))


def read_weights(path: Path, required: Iterable[str]) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """The document beside tensors, and these.

    Args:
        path: of the .safetensors file.
        required: names that the document must hold, beside its format and the weights' hash.

    Raises:
        ValueError: if a file is missing or damaged, or of another format, or the two do not belong together.
    """
    try:
        content = path.read_bytes()
        document = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
        tensors = load(content)
    except (OSError, UnicodeDecodeError, json.JSONDecodeError, SafetensorError) as error:
        raise ValueError(f"cannot read {path}: {error}") from None
    missing = [
        name for name in ("format", "sha256", *required) if not isinstance(document, dict) or name not in document
    ]
    if missing:
        raise ValueError(f"{path.with_suffix('.json')} lacks {', '.join(missing)}")
    if document["format"] != FORMAT:
        raise ValueError(f"{path} has format {document['format']}; this version of planarm reads {FORMAT}")
    if document["sha256"] != hashlib.sha256(content).hexdigest():
        raise ValueError(f"{path} and {path.with_suffix('.json').name} beside it do not belong together; restore both")
    return document, tensors


def _check_layout(path: Path, document: Mapping[str, Any]) -> None:
    env_id, now = document["env"], describe_layout(layout_of(document["env"], document["env_config"]))
    if now["layout_hash"] == document["layout_hash"]:
        return
    before = document.get("layout", [])
    changed = [
        entry["name"] for entry in [*before, *now["layout"]] if entry not in before or entry not in now["layout"]
    ]
    what = ", ".join(dict.fromkeys(changed)) or "their order"
    raise ValueError(
        f"{path} was trained on other observations of {env_id} than this version of planarm gives (changed: {what}); "
        "train it anew, or use the version named in its JSON"
    )


def _check_tensors(tensors: Tensors, layers: int) -> None:
    """Raise a ValueError unless the layers fit together."""
    names = [f"layer{layer}.{part}" for layer in range(layers) for part in ("weight", "bias")]
    missing = [name for name in ("fine.index", "fine.gain", "log_std", *names) if name not in tensors]
    if missing:
        raise ValueError(f"an agent without {', '.join(missing)}")
    for layer in range(layers):
        weight, bias = tensors[f"layer{layer}.weight"], tensors[f"layer{layer}.bias"]
        following = tensors[f"layer{layer + 1}.weight"].shape[1] if layer + 1 < layers else tensors["log_std"].size
        if weight.shape[0] != bias.size or weight.shape[0] != following:
            raise ValueError(f"layer {layer} of an agent has {weight.shape[0]} outputs; the next takes {following}")
