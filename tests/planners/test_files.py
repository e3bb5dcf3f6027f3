"""Files are written whole or not at all, JSON strictly."""

from __future__ import annotations

import json
import math
import os
import resource
import stat
import threading
from pathlib import Path

import numpy as np
import pytest

from planners.files import check_output, whole_file, write_json, write_text


def refuse_constant(name: str) -> None:
    raise AssertionError(f"{name} is no JSON")


def test_json_is_strict(tmp_path: Path) -> None:
    path = tmp_path / "new" / "results.json"
    document = {
        "array": np.array([1.0, np.inf, -np.inf, np.nan]),
        "flags": np.array([True, False]),
        "count": np.int64(3),
        "nested": {"tuple": (1, math.nan, "text", None)},
    }
    write_json(path, document)
    assert json.loads(path.read_text(), parse_constant=refuse_constant) == {
        "array": [1.0, None, None, None],
        "flags": [True, False],
        "count": 3,
        "nested": {"tuple": [1, None, "text", None]},
    }


def test_what_cannot_be_written_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "results.json"
    write_text(path, "old")
    with pytest.raises(TypeError):
        write_json(path, {"thing": object()})
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_an_interrupted_draft_is_gone(tmp_path: Path) -> None:
    path = tmp_path / "film.gif"

    def write_half() -> None:
        with whole_file(path) as draft:
            assert draft.suffix == ".gif"
            draft.write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_half()
    assert list(tmp_path.iterdir()) == []


def test_behind_a_link_the_file_that_it_leads_to_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    link, target = tmp_path / "link.json", tmp_path / "there" / "target.json"
    link.symlink_to(target)
    for text in ("made", "replaced"):
        write_text(link, text)
        assert link.is_symlink()
        assert target.read_text() == text
    target.chmod(0o640)
    write_text(link, "again")
    assert stat.S_IMODE(target.stat().st_mode) == 0o640
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["link.json", "target.json", "there"]


def test_a_pipe_gets_the_content_and_stays_a_pipe(tmp_path: Path) -> None:
    pipe, read = tmp_path / "pipe.json", []
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: read.append(pipe.read_text()))
    reader.start()
    check_output(pipe)
    write_text(pipe, "through")
    reader.join()
    assert read == ["through"]
    assert pipe.is_fifo()
    assert list(tmp_path.iterdir()) == [pipe]


def test_a_device_stays_a_device() -> None:
    check_output(Path("/dev/null"))
    write_text(Path("/dev/null"), "gone")
    assert Path("/dev/null").is_char_device()
    with pytest.raises(OSError, match="cannot write /dev/full: No space left"):
        write_text(Path("/dev/full"), "too much")


def test_a_chain_of_links_is_followed_and_a_circle_refused(tmp_path: Path) -> None:
    first, second, last = (tmp_path / name for name in ("a.json", "b.json", "c.json"))
    first.symlink_to(second)
    second.symlink_to("c.json")
    write_text(first, "through")
    assert first.is_symlink()
    assert second.is_symlink()
    assert last.read_text() == "through"
    last.unlink()
    last.symlink_to(first)
    with pytest.raises(ValueError, match="circle"):
        check_output(first)


def test_a_new_file_has_the_permissions_of_the_mask(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        write_text(tmp_path / "new.json", "{}")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "new.json").stat().st_mode) == 0o640


def test_long_names_of_many_bytes(tmp_path: Path) -> None:
    path = tmp_path / ("\u4e2d" * 80 + ".json")
    check_output(path)
    write_text(path, "{}")
    assert [each.name for each in tmp_path.iterdir()] == [path.name]


def test_an_open_file_goes_on_where_it_is(tmp_path: Path) -> None:
    path = tmp_path / "printed.txt"
    with path.open("wb") as file:
        file.write(b"before\n")
        file.flush()
        check_output(Path(f"/dev/fd/{file.fileno()}"))
        write_text(Path(f"/dev/fd/{file.fileno()}"), "between\n")
        file.write(b"after\n")
    assert path.read_text() == "before\nbetween\nafter\n"


def test_a_full_disk_leaves_the_old_file(tmp_path: Path) -> None:
    path, limits = tmp_path / "results.json", resource.getrlimit(resource.RLIMIT_FSIZE)
    write_text(path, "old")
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, limits[1]))
    try:
        with pytest.raises(OSError, match=r"cannot write .*results\.json: File too large"):
            write_text(path, "new" * 4096)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_what_cannot_be_written_is_said_before_the_work(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("a file")
    check_output(None)
    check_output(tmp_path / "new" / "folder" / "results.json")
    assert not (tmp_path / "new").exists()
    for path, complaint in (
        (tmp_path, "it is a folder"),
        (tmp_path / "file" / "results.json", "Not a directory"),
        (Path("/proc/results.json"), "cannot write /proc/results.json"),
        (Path("results\0.json"), "null"),
        (tmp_path / f"{'long' * 80}.json", "cannot write .*: File name too long"),
    ):
        with pytest.raises(ValueError, match=complaint):
            check_output(path)
