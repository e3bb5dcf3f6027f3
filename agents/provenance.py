"""What a result must say of where it was made."""

from __future__ import annotations

import os
import platform
from importlib import metadata
from typing import Any

DISTRIBUTIONS = ("planarm", "numpy", "numba", "scipy", "pymunk", "gymnasium")


def versions() -> dict[str, str]:
    """Versions of Python and of the libraries that results depend on."""
    return {"python": platform.python_version(), **{name: metadata.version(name) for name in DISTRIBUTIONS}}


def machine() -> dict[str, Any]:
    """The operating system, and the kind and number of processors."""
    return {"system": platform.platform(), "processor": platform.machine(), "cpus": os.cpu_count()}
