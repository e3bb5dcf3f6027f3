"""Versions and machine that a result was made with."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from importlib import metadata
from typing import Any

import llvmlite.binding as llvm

DISTRIBUTIONS = ("planarm", "numpy", "numba", "scipy", "pymunk", "gymnasium")


def versions(more: Sequence[str] = ()) -> dict[str, str]:
    """Versions of Python, of the libraries that results depend on, and of the named others."""
    return {"python": platform.python_version(), **{name: metadata.version(name) for name in (*DISTRIBUTIONS, *more)}}


def machine() -> dict[str, Any]:
    """The operating system, and the kind, model and number of processors."""
    return {"system": platform.platform(), "processor": platform.machine(), "cpu": cpu(), "cpus": os.cpu_count()}


def cpu() -> str:
    """The model of the processor, as LLVM names it."""
    return str(llvm.get_host_cpu_name())
