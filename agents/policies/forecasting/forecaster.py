"""A trained forecaster of discs, kept as safetensors and JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.policies.agent import FORMAT, Tensors, read_weights, write_weights
from agents.policies.forecasting.features import FEATURES
from agents.policies.forecasting.futures import OUTPUTS, Network

ENV_ID = "ObstacleDodge-v0"
"""Whose discs it forecasts."""

_REQUIRED = ("env", "features", "outputs", "hidden")


@dataclass(frozen=True)
class Forecaster:
    """A network that says where a disc may go.

    Attributes:
        document: what its JSON says: architecture, how it was trained, scores.
        tensors: those of `Network`, by name, float32.
    """

    document: Mapping[str, Any]
    tensors: Tensors

    @cached_property
    def network(self) -> Network:
        """The weights as the kernels want them."""
        return Network(*(np.ascontiguousarray(self.tensors[name], dtype=np.float64) for name in Network._fields))


def describe_network(tensors: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    """What a forecaster's JSON says of its network."""
    return {
        "format": FORMAT,
        "env": ENV_ID,
        "features": FEATURES,
        "outputs": OUTPUTS,
        "hidden": [len(tensors["bias0"]), len(tensors["bias1"])],
    }


def is_forecaster(path: Path) -> bool:
    """Whether a file is one of a forecaster's weights, by the JSON beside it."""
    try:
        document = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(document, dict) and all(name in document for name in _REQUIRED)


def load_forecaster(path: str | Path | None = None) -> Forecaster:
    """A trained forecaster: that of a .safetensors file with its JSON beside it, or the one shipped with planarm.

    Raises:
        ValueError: if its files are missing or damaged, or it was trained on other features.
    """
    shipped = resources.files("agents.policies.forecasting").joinpath("trained", f"{ENV_ID}.safetensors")
    source = Path(str(shipped if path is None else path))
    document, tensors = read_weights(source, _REQUIRED)
    absent = [name for name in Network._fields if name not in tensors]
    if absent:
        raise ValueError(f"{source} lacks {', '.join(absent)}")
    kind = (document["env"], document["features"], document["outputs"])
    if kind != (ENV_ID, FEATURES, OUTPUTS):
        raise ValueError(
            f"{source} is for {kind[0]}, with {kind[1]} features and {kind[2]} outputs; this version of planarm has "
            f"{FEATURES} and {OUTPUTS} for {ENV_ID}: train it anew"
        )
    for name, shape in network_shapes(*document["hidden"]).items():
        if tensors[name].shape != shape:
            raise ValueError(f"{source}: {name} has shape {tensors[name].shape}, not {shape} as its JSON says")
    return Forecaster(document, tensors)


def network_shapes(first: int, second: int) -> dict[str, tuple[int, ...]]:
    """Shapes of the tensors of a `Network` with hidden layers so wide, by name."""
    layers = enumerate(((first, FEATURES), (second, first), (OUTPUTS, second)))
    shapes = {
        f"{kind}{i}": shape if kind == "weight" else shape[:1] for i, shape in layers for kind in ("weight", "bias")
    }
    return {"mean": (FEATURES,), "spread": (FEATURES,), **shapes}


def save_forecaster(forecaster: Forecaster, path: Path) -> None:
    """Write weights to ``path`` (.safetensors), and the JSON beside them; each whole or not at all."""
    write_weights(path, forecaster.document, forecaster.tensors)
