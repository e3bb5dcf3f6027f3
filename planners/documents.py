"""Reading of YAML, JSON and NPZ from anybody: bounded in size and depth, without references, tags and pickles."""

from __future__ import annotations

import json
import os
import re
import zipfile
from collections.abc import Hashable
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

MOST_BYTES = 1 << 16
"""Largest size of a file, bytes, unless its reader allows for more."""

DEEPEST = 12
"""Most levels of lists and mappings within each other."""

MOST_BITS = 64
"""Most bits of an integer."""

_LONGEST = 300  # characters of a complaint that come from the file
_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # libyaml takes a tenth of the time


def read_document(path: Path, most_bytes: int = MOST_BYTES) -> Any:
    """The content of a YAML file, or of a JSON file if its name ends in .json.

    Raises:
        ValueError: if there is no such file, it is larger than ``most_bytes`` or too deep, no text, or no YAML or JSON;
            if a key stands twice in a mapping or is no text; or if a value is a date or a huge integer.
    """
    if not os.path.exists(path):
        raise ValueError(f"cannot read {path}: no such file")
    if not os.path.isfile(path):
        raise ValueError(f"cannot read {path}: it is no file")
    try:
        with path.open("rb") as file:
            content = file.read(most_bytes + 1)
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError(f"cannot read {path}: it is no text in UTF-8") from None
    except OSError as error:
        raise ValueError(f"cannot read {path}: {error.strerror}") from None
    if len(content) > most_bytes:
        raise ValueError(f"cannot read {path}: it is larger than {most_bytes // 1024} KiB")
    return parse_json(text, str(path)) if path.suffix.lower() == ".json" else parse_yaml(text, str(path))


def parse_yaml(text: str, what: str) -> Any:
    """The value of a YAML text; ``what`` it is, for messages. Raises ValueError as `read_document` does."""
    try:
        depth = 0
        for event in yaml.parse(text, Loader=_Loader):
            if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None) is not None:
                raise ValueError("references (& and *) are not read; write the values out")
            if (tag := getattr(event, "tag", None)) is not None:
                raise ValueError(f"tags ({tag}) are not read; write plain values")
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if depth > DEEPEST:
                raise ValueError(f"more than {DEEPEST} levels of lists and mappings")
        return _checked(yaml.load(text, Loader=_PlainLoader))  # nosec B506: a SafeLoader, see below
    except (yaml.YAMLError, ValueError, OverflowError) as error:
        raise ValueError(f"{what} is no YAML: {' '.join(str(error).split())[:_LONGEST]}") from None


def parse_json(text: str, what: str) -> Any:
    """The value of a JSON text; ``what`` it is, for messages. Raises ValueError as `read_document` does."""
    try:
        return _checked(json.loads(text, object_pairs_hook=_unique))
    except RecursionError:
        raise ValueError(f"{what} is no JSON: more than {DEEPEST} levels of lists and mappings") from None
    except ValueError as error:
        raise ValueError(f"{what} is no JSON: {str(error)[:_LONGEST]}") from None


def read_arrays(path: Path, most_bytes: int) -> dict[str, NDArray[Any]]:
    """The arrays of an NPZ file by name. Nothing is unpickled.

    Raises:
        ValueError: if it cannot be read, is no NPZ file, or holds more than ``most_bytes``.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
        if size > most_bytes:
            raise ValueError(f"it holds {size} bytes; {most_bytes} are the most")
        with np.load(path, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
        if odd := [name for name, array in arrays.items() if not isinstance(array, np.ndarray)]:
            raise ValueError(f"{odd[0]!r:.40} is no array")
    except Exception as error:  # a damaged archive can fail in any way
        reason = getattr(error, "strerror", None) or error or type(error).__name__
        raise ValueError(f"cannot read {path}: {' '.join(str(reason).split())[:_LONGEST]}") from None
    return arrays


def _checked(document: Any) -> Any:
    """The document as it is, if it holds nothing but texts, numbers, true, false, null, lists and mappings of them."""
    pending = [(document, 1)]
    while pending:
        value, depth = pending.pop()
        if isinstance(value, (dict, list)):
            if depth > DEEPEST:
                raise ValueError(f"more than {DEEPEST} levels of lists and mappings")
            pending += [(item, depth + 1) for item in (value.values() if isinstance(value, dict) else value)]
            for key in value if isinstance(value, dict) else ():
                if not isinstance(key, str):
                    raise ValueError(f"the key {key!s:.40} is no text: put it in quotes")
        elif isinstance(value, int):
            if value.bit_length() > MOST_BITS:
                raise ValueError(f"an integer of {value.bit_length()} bits; {MOST_BITS} are the most")
        elif not isinstance(value, (str, float, type(None))):
            raise ValueError(f"{value!s:.40} is read as a {type(value).__name__}: put it in quotes")
    return document


class _PlainLoader(_Loader):  # type: ignore[misc]
    """Refuses a key that stands twice in a mapping, and reads 1e-4 and 010 as numbers, as YAML 1.2 does."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        _unique([(self.construct_object(key, deep=True), None) for key, _ in node.value])
        mapping: dict[Hashable, Any] = super().construct_mapping(node, deep)
        return mapping


def _whole_number(loader: _PlainLoader, node: yaml.ScalarNode) -> Any:
    """A whole number as YAML 1.2 reads it, or with thousands apart (1_000): 010 is ten; 1:30, 1_0, 0b11 are texts."""
    text = str(node.value)
    if re.fullmatch(r"[-+]?(0[0-9]+|[0-9]{1,3}(_[0-9]{3})+)", text):
        return int(text, 10)
    return text if re.search("[:_b]", text) else loader.construct_yaml_int(node)


def _fraction(loader: _PlainLoader, node: yaml.ScalarNode) -> Any:
    """A number with a point as YAML 1.2 reads it: 1:30.5 and 1_0.5 are texts."""
    return node.value if re.search("[:_]", node.value) else loader.construct_yaml_float(node)


_PlainLoader.add_constructor("tag:yaml.org,2002:int", _whole_number)
_PlainLoader.add_constructor("tag:yaml.org,2002:float", _fraction)
_POWER_OF_TEN = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+$")
_PlainLoader.add_implicit_resolver("tag:yaml.org,2002:float", _POWER_OF_TEN, list("-+.0123456789"))


def _unique(pairs: list[tuple[Any, Any]]) -> dict[Any, Any]:
    """The pairs as a mapping, or ValueError if a key stands in two."""
    found: dict[Any, Any] = {}
    for key, value in pairs:
        if not isinstance(key, Hashable):
            raise ValueError(f"{key!r:.40} cannot be a key")
        if key in found:
            raise ValueError(f'"{key!s:.40}" is given twice')
        found[key] = value
    return found
