"""Files are written whole or not at all, JSON strictly."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from planners.files import whole_file, write_json, write_text


def refuse_constant(name: str) -> None:
    raise AssertionError(f"{name} is no JSON")


def test_json_is_strict(tmp_path: Path) -> None:
    path = tmp_path / "new" / "results.json"
    document = {
        "array": np.array([1.0, np.inf, -np.inf, np.nan]),
        "flags": np.array([True, False]),
        "count": np.int64(3),
        "nested": {"tuple": (1, math.nan, "text", None)},
    }
    write_json(path, document)
    assert json.loads(path.read_text(), parse_constant=refuse_constant) == {
        "array": [1.0, None, None, None],
        "flags": [True, False],
        "count": 3,
        "nested": {"tuple": [1, None, "text", None]},
    }


def test_what_cannot_be_written_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "results.json"
    write_text(path, "old")
    with pytest.raises(TypeError):
        write_json(path, {"thing": object()})
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_an_interrupted_draft_is_gone(tmp_path: Path) -> None:
    path = tmp_path / "film.gif"

    def write_half() -> None:
        with whole_file(path) as draft:
            assert draft.suffix == ".gif"
            draft.write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_half()
    assert list(tmp_path.iterdir()) == []
