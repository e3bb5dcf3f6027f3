from __future__ import annotations

import os
from pathlib import Path

import pytest

from planners.compile_cache import drop_stale


@pytest.fixture
def packages(tmp_path: Path) -> tuple[Path, Path]:
    """Two packages whose sources are a minute old, and whose caches are new."""
    for name in ("lower", "upper"):
        folder = tmp_path / name
        (folder / "__pycache__").mkdir(parents=True)
        source = folder / "kernel.py"
        source.write_text("import lower.kernel\n" if name == "upper" else "")
        os.utime(source, (source.stat().st_atime, source.stat().st_mtime - 60.0))
        for ending in ("nbi", "1.nbc"):
            (folder / "__pycache__" / f"kernel.{ending}").touch()
    return tmp_path / "lower", tmp_path / "upper"


def caches(folder: Path) -> int:
    return len(list(folder.rglob("*.nb?")))


def test_fresh_caches_are_kept(packages: tuple[Path, Path]) -> None:
    lower, upper = packages
    drop_stale(upper, sources=(lower,))
    assert caches(upper) == 2


def test_a_newer_source_drops_its_own_cache(packages: tuple[Path, Path]) -> None:
    lower, upper = packages
    os.utime(upper / "kernel.py", (1e10, 1e10))
    drop_stale(upper)
    assert caches(upper) == 0
    assert caches(lower) == 2


def test_a_newer_source_that_is_not_imported_changes_nothing(packages: tuple[Path, Path]) -> None:
    _, upper = packages
    (upper / "other.py").touch()
    os.utime(upper / "other.py", (1e10, 1e10))
    drop_stale(upper)
    assert caches(upper) == 2


@pytest.mark.parametrize(
    "line",
    [
        "from upper.other import name",
        "from upper import other",
        "from upper import (\n    absent,\n    other,\n)",
        "import upper.other",
        "from upper import middle",
    ],
)
def test_a_newer_source_that_is_imported_drops_the_cache(packages: tuple[Path, Path], line: str) -> None:
    _, upper = packages
    (upper / "other.py").touch()
    os.utime(upper / "other.py", (1e10, 1e10))
    (upper / "middle.py").write_text("def later():\n    from upper.other import name\n")
    (upper / "kernel.py").write_text(line + "\n")
    for source in ("kernel.py", "middle.py"):
        os.utime(upper / source, (0.0, 0.0))
    drop_stale(upper)
    assert caches(upper) == 0


def test_a_cache_without_a_source_is_dropped(packages: tuple[Path, Path]) -> None:
    _, upper = packages
    (upper / "other.py").touch()
    os.utime(upper / "other.py", (1e10, 1e10))
    (upper / "kernel.py").unlink()
    drop_stale(upper)
    assert caches(upper) == 0


def test_a_newer_source_of_a_lower_package_counts(packages: tuple[Path, Path]) -> None:
    lower, upper = packages
    os.utime(lower / "kernel.py", (1e10, 1e10))
    drop_stale(upper, sources=(lower,))
    assert caches(upper) == 0


def test_no_cache_is_no_trouble(tmp_path: Path) -> None:
    (tmp_path / "kernel.py").touch()
    drop_stale(tmp_path)
    assert caches(tmp_path) == 0
