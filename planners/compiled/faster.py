"""Faster compilation, by changes of Numba's internals: with the versions of Numba that they were tested with.

Other versions compile in the time that they take.
"""

from __future__ import annotations

from importlib import import_module

import numba

TESTED = ((0, 68),)
"""Versions of Numba whose internals are known."""

if numba.version_info.short in TESTED:
    for _name in ("linking", "operators", "shortcuts"):
        import_module(f"planners.compiled.{_name}")
