"""Reading of YAML and JSON from anybody: bounded in size and depth, without the references and tags of YAML."""

from __future__ import annotations

import json
import os
from collections.abc import Hashable
from pathlib import Path
from typing import Any

import yaml

MOST_BYTES = 1 << 16
"""Largest size of a file, bytes."""

DEEPEST = 12
"""Most levels of lists and mappings within each other."""


def read_document(path: Path) -> Any:
    """The content of a YAML file, or of a JSON file if its name ends in .json.

    Raises:
        ValueError: if there is no such file, it is too large or too deep, no text, or no YAML or JSON; or if a key
            stands twice in a mapping.
    """
    if not os.path.exists(path):
        raise ValueError(f"cannot read {path}: no such file")
    if not os.path.isfile(path):
        raise ValueError(f"cannot read {path}: it is no file")
    try:
        with path.open("rb") as file:
            content = file.read(MOST_BYTES + 1)
        text = content.decode()
    except UnicodeDecodeError:
        raise ValueError(f"cannot read {path}: it is no text in UTF-8") from None
    except OSError as error:
        raise ValueError(f"cannot read {path}: {error.strerror}") from None
    if len(content) > MOST_BYTES:
        raise ValueError(f"cannot read {path}: it is larger than {MOST_BYTES // 1024} KiB")
    return parse_json(text, str(path)) if path.suffix.lower() == ".json" else parse_yaml(text, str(path))


def parse_yaml(text: str, what: str) -> Any:
    """The value of a YAML text; ``what`` it is, for messages. Raises ValueError as `read_document` does."""
    try:
        depth = 0
        for event in yaml.parse(text, Loader=yaml.SafeLoader):
            if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None) is not None:
                raise ValueError("references (& and *) are not read; write the values out")
            if (tag := getattr(event, "tag", None)) is not None:
                raise ValueError(f"tags ({tag}) are not read; write plain values")
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if depth > DEEPEST:
                raise ValueError(f"more than {DEEPEST} levels of lists and mappings")
        return yaml.load(text, Loader=_NoKeyTwice)
    except (yaml.YAMLError, ValueError, OverflowError) as error:
        raise ValueError(f"{what} is no YAML: {' '.join(str(error).split())}") from None


def parse_json(text: str, what: str) -> Any:
    """The value of a JSON text; ``what`` it is, for messages. Raises ValueError as `read_document` does."""
    try:
        return json.loads(text, object_pairs_hook=_unique)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{what} is no JSON: {error}") from None


class _NoKeyTwice(yaml.SafeLoader):
    """Refuses a key that stands twice in a mapping."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        _unique([(self.construct_object(key, deep=True), None) for key, _ in node.value])
        return super().construct_mapping(node, deep)


def _unique(pairs: list[tuple[Any, Any]]) -> dict[Any, Any]:
    """The pairs as a mapping, or ValueError if a key stands in two."""
    found: dict[Any, Any] = {}
    for key, value in pairs:
        if not isinstance(key, Hashable):
            raise ValueError(f"{key!r} cannot be a key")
        if key in found:
            raise ValueError(f'"{key}" is given twice')
        found[key] = value
    return found
