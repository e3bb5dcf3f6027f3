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
        source.touch()
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


def test_a_newer_source_drops_all_of_the_package(packages: tuple[Path, Path]) -> None:
    lower, upper = packages
    (upper / "other.py").touch()
    os.utime(upper / "other.py", (1e10, 1e10))
    drop_stale(upper)
    assert caches(upper) == 0
    assert caches(lower) == 2


def test_a_newer_source_of_a_lower_package_counts(packages: tuple[Path, Path]) -> None:
    lower, upper = packages
    os.utime(lower / "kernel.py", (1e10, 1e10))
    drop_stale(upper, sources=(lower,))
    assert caches(upper) == 0


def test_no_cache_is_no_trouble(tmp_path: Path) -> None:
    (tmp_path / "kernel.py").touch()
    drop_stale(tmp_path)
    assert caches(tmp_path) == 0
