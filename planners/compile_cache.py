"""Deletion of stale numba caches.

Numba recompiles a function when its own file changes, but not when a function that it calls changes in another file:
after an update it would run a mixture of old and new code.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator
from pathlib import Path

_IMPORT = re.compile(r"^\s*(?:from ([\w.]+) import \(?([\w, \n]+)|import ([\w.]+))", re.MULTILINE)


def drop_stale(package: Path, *, sources: tuple[Path, ...] = ()) -> None:
    """Delete compiled caches older than the module's file or any file it imports, directly or not.

    Args:
        package: folder of the package.
        sources: folders of other packages with compiled functions that it calls.
    """
    folders = (package, *sources)
    caches = {path: path.stat().st_mtime for path in package.rglob("*.nb[ic]")}
    changed = {path: path.stat().st_mtime for folder in folders for path in folder.rglob("*.py")}
    if not caches or min(caches.values()) >= max(changed.values()):
        return
    roots = {folder.name: folder.parent for folder in folders}
    imports = {path: list(_imports(path, roots)) for path in changed}
    newest: dict[Path, float] = {}
    for path, made in caches.items():
        source = path.parent.parent / f"{path.name.split('.')[0]}.py"
        if source not in newest:
            newest[source] = max(changed.get(one, float("inf")) for one in _reached_from(source, imports))
        if made < newest[source]:
            # Another process may have deleted it, or the folder may be read-only.
            with contextlib.suppress(OSError):
                path.unlink()


def _reached_from(source: Path, imports: dict[Path, list[Path]]) -> set[Path]:
    """A source file and its direct and indirect imports."""
    reached, pending = set(), [source]
    while pending:
        path = pending.pop()
        if path not in reached:
            reached.add(path)
            pending += imports.get(path, [])
    return reached


def _imports(path: Path, roots: dict[str, Path]) -> Iterator[Path]:
    """Files of the modules that a file imports from packages below the roots."""
    for module, names, plain in _IMPORT.findall(path.read_text(encoding="utf-8")):
        parts = (module or plain).split(".")
        if parts[0] not in roots:
            continue
        place = roots[parts[0]].joinpath(*parts)
        submodules = [place / name.split(" as ")[0].strip() for name in names.split(",")] if names else []
        found = [one for one in submodules if one.with_suffix(".py").is_file() or (one / "__init__.py").is_file()]
        for one in found if submodules and len(found) == len(submodules) else [*found, place]:
            yield one / "__init__.py" if (one / "__init__.py").is_file() else one.with_suffix(".py")
