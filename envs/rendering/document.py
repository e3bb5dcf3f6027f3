"""A scene as a JSON document, for pages that draw it in a browser."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

from envs.rendering import palette
from envs.rendering.scene import Belt, Scene

DIGITS = 4
"""Decimals of the numbers in a document: 0.1 mm, and 0.01 % of a limit."""


def scene_document(scene: Scene) -> dict[str, Any]:
    """A scene in JSON types, by the names of its fields; parts that are not drawn are null."""
    return {each.name: _plain(getattr(scene, each.name)) for each in fields(scene)}


def palette_document() -> dict[str, dict[str, str]]:
    """The colours of every picture as CSS colours by name, for light and for dark pages."""
    light = {name.lower(): color for name, color in vars(palette).items() if name.isupper()}
    dark = light | {name.lower(): color for name, color in palette.DARK.items()}
    light.pop("dark"), dark.pop("dark")
    return {
        "light": {name: _css(color) for name, color in light.items()},
        "dark": {n: _css(c) for n, c in dark.items()},
    }


def _css(color: palette.Color) -> str:
    return "#" + "".join(f"{part:02x}" for part in color)


def _plain(value: Any) -> Any:
    if isinstance(value, Belt):
        return {each.name: _plain(getattr(value, each.name)) for each in fields(value)}
    if isinstance(value, (bool, str)) or value is None:
        return value
    if isinstance(value, (np.ndarray, list, tuple)):
        return [_plain(item) for item in value]
    number = float(value)
    return round(number, DIGITS) if np.isfinite(number) else None
