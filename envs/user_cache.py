"""The folder in which results that take long to compute are kept for the user, and files in it."""

from __future__ import annotations

import os
import tempfile
import warnings
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from planners.compile_cache import temporary_folder
from planners.documents import read_arrays
from planners.files import whole_file

_MOST_BYTES = 1 << 28


def cache_folder() -> Path:
    """``PLANARM_CACHE``, or ``planarm`` in ``XDG_CACHE_HOME`` or in ``~/.cache``; made if it does not exist.

    Where none of them can be written, a temporary folder, with one warning.
    """
    own, shared = os.environ.get("PLANARM_CACHE"), os.environ.get("XDG_CACHE_HOME")
    return _writable(own, shared, os.environ.get("HOME"))


@cache
def _writable(own: str | None, shared: str | None, home: str | None) -> Path:
    if own:
        wanted = Path(own)
    elif shared:
        wanted = Path(shared) / "planarm"
    else:
        wanted = Path(home or os.path.expanduser("~")) / ".cache" / "planarm"
    try:
        if str(wanted).startswith("~"):
            raise OSError(0, "there is no home folder")
        wanted.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=wanted):
            return wanted
    except OSError as error:
        return temporary_folder(
            f"results are not kept for the next time: {wanted} cannot be written ({error.strerror}); "
            "set PLANARM_CACHE to a folder that can"
        )


def load_arrays(name: str) -> dict[str, NDArray[np.float64]] | None:
    """Arrays of a file in the cache; None if there is none, or it cannot be read."""
    try:
        stored = read_arrays(cache_folder() / name, _MOST_BYTES)
        return {key: np.asarray(array, dtype=np.float64) for key, array in stored.items()}
    except (ValueError, TypeError):
        return None


def store_arrays(name: str, arrays: Mapping[str, NDArray[np.float64]]) -> None:
    """Write arrays to a file in the cache, which appears whole or not at all; a full disk is no error."""
    path = cache_folder() / name
    try:
        with whole_file(path) as draft:
            np.savez_compressed(draft, **arrays)  # type: ignore[arg-type]
    except OSError as error:
        warnings.warn(f"{path} cannot be written: {error.strerror}", RuntimeWarning, stacklevel=3)
