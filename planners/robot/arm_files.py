"""Arms by name, from files and from mappings: YAML or JSON with the unit in each key.

A mapping holds the values of an `Arm`; `arm_document` gives one that leads back to the same arm, to the bit.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from planners.checks import brief, refuse_unknown
from planners.documents import read_document
from planners.robot.arm import Arm
from planners.robot.limits import LIMIT_KINDS, JointLimits, LimitKind
from planners.robot.presets import PRESETS

FOLDER = Path(__file__).parent.parent.parent / "configs" / "arms"
"""Files of the arms that come with planarm, each named after its arm."""

_SUFFIXES = (".yaml", ".yml", ".json")

KEYS = {
    "lengths_m": "lengths",
    "masses_kg": "masses",
    "coms_m": "coms",
    "inertias_kg_m2": "inertias",
    "gravity_m_s2": "gravity",
    "base_m": "base",
    "link_radius_m": "link_radius",
}
"""Attribute of `Arm` that each key of a document sets. Further keys are ``name``, ``limits``, and ``source``, a text
that says where the values come from and is not read."""

_DEGREE = math.pi / 180.0
LIMIT_KEYS: dict[str, tuple[LimitKind, float]] = {
    "torque_N_m": ("torque", 1.0),
    "velocity_rad_s": ("velocity", 1.0),
    "velocity_deg_s": ("velocity", _DEGREE),
    "acceleration_rad_s2": ("acceleration", 1.0),
    "acceleration_deg_s2": ("acceleration", _DEGREE),
    "jerk_rad_s3": ("jerk", 1.0),
    "jerk_deg_s3": ("jerk", _DEGREE),
    "angle_rad": ("angle", 1.0),
    "angle_deg": ("angle", _DEGREE),
}
"""Kind of limit that each key of ``limits`` sets, and its unit in SI."""

_NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?|[-+]?inf")
_SI_KEYS = {kind: key for key, (kind, unit) in LIMIT_KEYS.items() if unit == 1.0}


def arm_names() -> list[str]:
    """Names of the arms that come with planarm: those of the papers and those of ``configs/arms``."""
    return sorted([*PRESETS, *(path.stem for path in FOLDER.glob("*.yaml"))])


def load_arm(spec: Arm | str | Path | Mapping[str, Any]) -> Arm:
    """An arm from its name (see `arm_names`), from a YAML or JSON file, or from a mapping with the same keys.

    An `Arm` is returned as it is. A name or path that ends in .yaml, .yml or .json is a file.

    Raises:
        ValueError: if there is no such file or name, or the values are no arm; the message says what is known or
            allowed.
    """
    if isinstance(spec, Arm):
        return spec
    if isinstance(spec, Mapping):
        return _from_mapping(spec, "arm", "arm")
    if not isinstance(spec, str | Path):
        raise ValueError(f"{brief(spec)} is no arm; give an Arm, a name, the path of a YAML or JSON file, or a mapping")
    if isinstance(spec, str) and spec in PRESETS:
        return PRESETS[spec]
    path = Path(spec)
    if path.suffix.lower() not in _SUFFIXES:
        names = arm_names()
        refuse_unknown([str(spec)], names, "arm (a file's name ends in .yaml or .json)")
        path = FOLDER / f"{spec}.yaml"
    elif not os.path.exists(path):
        raise ValueError(f"no file {path}; the arms known by name are {', '.join(arm_names())}")
    document = read_document(path)
    if not isinstance(document, Mapping):
        raise ValueError(f"{path} must hold the keys and values of an arm, not {document!r:.80}")
    return _from_mapping(document, path.stem, str(path))


def arm_document(arm: Arm | str | Path) -> dict[str, Any]:
    """The arm as a mapping of strict JSON, from which `load_arm` makes the same arm; no limit is None or left out.

    A name or a file is loaded first, as by `load_arm`.
    """
    arm, limits = load_arm(arm), {}
    for kind in LIMIT_KINDS:
        values = getattr(arm.limits, kind)
        if any(value != math.inf for value in values):
            limits[_SI_KEYS[kind]] = [_plain(value) for value in values]
    return {
        "name": arm.name,
        **{key: _plain(getattr(arm, attribute)) for key, attribute in KEYS.items()},
        "limits": limits,
    }


def _plain(value: Any) -> Any:
    """A number or numbers in types of JSON; None for inf."""
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    return None if value == math.inf else value


def _from_mapping(document: Mapping[str, Any], name: str, what: str) -> Arm:
    """The arm of a document; ``what`` it is, for messages."""
    refuse_unknown(document, [*KEYS, "name", "limits", "source"], f"key of {what}")
    document = {key: value for key, value in document.items() if value is not None}  # null is as good as left out
    missing = [key for key in ("lengths_m", "masses_kg") if key not in document]
    if missing:
        raise ValueError(f"{what} has no {' and no '.join(missing)}; an arm needs lengths_m and masses_kg")
    name = document.get("name", name)
    if not isinstance(name, str):
        raise ValueError(f"{what}: name {brief(name)} must be a text")
    given: dict[str, Any] = {attribute: _numbers(document[key]) for key, attribute in KEYS.items() if key in document}
    try:
        return Arm(name=name, limits=_limits(document.get("limits", {})), **given)
    except ValueError as error:
        raise ValueError(f"{what}: {str(error).removeprefix(f'{name}: ')}") from None


def _limits(document: Any) -> JointLimits:
    """Joint limits of the ``limits`` of a document."""
    if not isinstance(document, Mapping):
        raise ValueError(f"limits {brief(document)} must be keys and values, as in torque_N_m: [10.0, 4.0]")
    refuse_unknown(document, LIMIT_KEYS, "key of limits")
    given: dict[LimitKind, Any] = {}
    for key, values in document.items():
        kind, unit = LIMIT_KEYS[key]
        if kind in given:
            raise ValueError(f"{kind} limits are given in two units; keep one of them")
        given[kind] = _numbers(values, unit, limits=True)
    return JointLimits(**given)


def _numbers(value: Any, unit: float = 1.0, *, limits: bool = False) -> Any:
    """Numbers of a document in SI units: YAML 1.1 reads 1e-3 as a text; a limit of null is none. Others as they are."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [_numbers(item, unit, limits=limits) for item in value]
    if value is None:
        return math.inf if limits else ()
    if isinstance(value, str):
        if not _NUMBER.fullmatch(value):
            return value
        value = float(value)
    return value * unit if isinstance(value, int | float) and not isinstance(value, bool) and unit != 1.0 else value
