"""Keeps numba's on-disk caches honest.

Numba compiles a function again when its own file changes, but not when a function that it calls has changed in another
file: after an update, or an edit, it would run a mixture of old and new code.
"""

from __future__ import annotations

import contextlib
from pathlib import Path


def drop_stale(package: Path, *, sources: tuple[Path, ...] = ()) -> None:
    """Delete the compiled caches of a package if one of them is older than any source it may have been made from.

    Args:
        package: folder of the package.
        sources: folders of other packages whose compiled functions it calls.
    """
    caches = [*package.rglob("*.nbi"), *package.rglob("*.nbc")]
    newest_source = max(path.stat().st_mtime for folder in (package, *sources) for path in folder.rglob("*.py"))
    if any(path.stat().st_mtime < newest_source for path in caches):
        for path in caches:
            # Another process may have deleted it, or the folder may be read-only.
            with contextlib.suppress(OSError):
                path.unlink()
