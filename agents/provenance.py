"""Versions and machine that a result was made with."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from importlib import metadata
from typing import Any

DISTRIBUTIONS = ("planarm", "numpy", "numba", "scipy", "pymunk", "gymnasium")


def versions(more: Sequence[str] = ()) -> dict[str, str]:
    """Versions of Python, of the libraries that results depend on, and of the named others."""
    return {"python": platform.python_version(), **{name: metadata.version(name) for name in (*DISTRIBUTIONS, *more)}}


def machine() -> dict[str, Any]:
    """The operating system, and the kind and number of processors."""
    return {"system": platform.platform(), "processor": platform.machine(), "cpus": os.cpu_count()}
