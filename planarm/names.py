"""Whether Python finds planarm's own `planners`, `envs`, `agents` and `configs`, and nobody else's of the same name."""

from __future__ import annotations

import csv
import os
import sys
from importlib.util import find_spec
from pathlib import Path

PACKAGES = ("planners", "envs", "agents")
ROOT = Path(__file__).parent.parent


def check_names() -> None:
    """Make sure that planarm's packages are found and whole.

    Takes about a millisecond: names are looked up without being imported, and sizes of files compared with those that
    the installer noted down.

    Raises:
        ImportError: if a package of the same name comes first on Python's path, or another distribution has overwritten
            or removed files, with what to do.
    """
    for name in PACKAGES:
        _check_place(name)
    _check_files()


def _check_place(name: str) -> None:
    """Raise an ImportError unless a package is found beside this one."""
    own = ROOT / name / "__init__.py"
    try:
        origin = getattr(find_spec(name), "origin", None)
    except ValueError:  # of a module that was made by hand
        origin = getattr(sys.modules[name], "__file__", None) or f"the module {name!r}"
    if origin is None or not own.is_file():
        raise ImportError(f"planarm's package {name!r} is not in {ROOT}; install planarm again")
    found = Path(origin)
    if os.path.realpath(found) != os.path.realpath(own):
        place = found.parent if found.name == "__init__.py" else found
        raise ImportError(
            f"{place} hides planarm's package {name!r} in {ROOT}: it has the same name and comes first on Python's "
            "path (sys.path); rename it, or run from another folder"
        )


def _check_files() -> None:
    """Raise an ImportError if installed files are missing or another distribution's."""
    record = next(ROOT.glob("planarm-*.dist-info/RECORD"), None)
    if record is None:  # a checkout
        return
    changed = {name for name, size in _recorded(record) if _size(name) != size}
    owners = _owners(changed, record) if changed else {}
    for name in sorted(changed):
        if name in owners:
            raise ImportError(
                f"{owners[name]} has overwritten planarm's {ROOT / name}: both install a package "
                f"{name.split('/')[0]!r}; install planarm in a virtual environment of its own"
            )
        if _size(name) is None:
            raise ImportError(
                f"planarm's {ROOT / name} is missing, perhaps removed together with another distribution that had a "
                "file of this name; install planarm again (pip install --force-reinstall --no-deps planarm)"
            )


def _recorded(record: Path) -> list[tuple[str, int]]:
    """Files of planarm's packages and their sizes, as they were installed."""
    starts = tuple(f"{folder}/" for folder in (*PACKAGES, "configs"))
    lines = [line for line in record.read_text(encoding="utf-8").splitlines() if line.startswith(starts)]
    return [(name, int(size)) for name, _, size in csv.reader(lines) if size]


def _size(name: str) -> int | None:
    try:
        return os.stat(f"{ROOT}{os.sep}{name}").st_size
    except OSError:
        return None


def _owners(names: set[str], own: Path) -> dict[str, str]:
    """The distributions that list one of these files as theirs."""
    owners = {}
    for record in ROOT.glob("*.dist-info/RECORD"):
        if record != own:
            with record.open(newline="", encoding="utf-8") as file:
                listed = names & {row[0] for row in csv.reader(file) if row}
            owners.update(dict.fromkeys(listed, record.parent.name.removesuffix(".dist-info").replace("-", " ")))
    return owners
