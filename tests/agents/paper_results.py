"""What the command of a paper writes, in the tests' own form."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class PaperResults:
    """The folder written to, the JSON in it, and the printed text."""

    folder: Path
    document: dict[str, Any]
    printed: str


Regenerate = Callable[[str], PaperResults]
