"""The folder of a training run: what it starts from, who works in it, and whether its files are what they should be."""

from __future__ import annotations

import hashlib
import json
import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

from agents.provenance import machine, versions
from agents.training.devices import described
from agents.training.recipe import TrainingConfig
from planners.documents import read_document
from planners.files import is_draft, write_bytes, write_json, write_text

RL_DISTRIBUTIONS = ("stable-baselines3", "torch", "safetensors")
LOCK = "lock"
_SUFFIXES = (".pt", ".npz", ".csv", ".json", ".yaml", ".safetensors")  # of the files of a run
COPIED = ".copied"  # at the end of the name of a file that takes the place of a link to it, for a moment
_FREE = ("device", "threads")  # settings that may change between two resumes
_ABSENT = "nothing"


class InUse(ValueError):
    """Another process trains in the folder."""


def write_origin(folder: Path, config: TrainingConfig, command: str) -> None:
    """Write what a run starts from: its settings, and the command, versions, machine and device.

    Raises:
        ValueError: if the folder is not empty, or no folder.
    """
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"{folder} is no folder: choose another --out")
    _require_empty(folder)
    with alone_in(folder):
        _require_empty(folder)
        settings = config.model_dump(mode="json")
        origin = {"command": command, "seed": config.seed, "versions": versions(RL_DISTRIBUTIONS)}
        write_text(folder / "config.yaml", yaml.safe_dump(settings, sort_keys=False))
        write_json(folder / "run.json", {**origin, "machine": {**machine(), **described(config)}, "config": settings})


def _require_empty(folder: Path) -> None:
    """Raise a ValueError if a folder holds more than what a killed process may have left."""
    if folder.exists() and any(path.name != LOCK and not is_draft(path) for path in folder.iterdir()):
        raise ValueError(f"{folder} is not empty: choose another --out, or continue the run there: --resume {folder}")


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Keep other processes from training in a folder meanwhile, and remove what killed ones have left half-written.

    Raises:
        InUse: if one is training there. The lock ends with its process, however that ends.
    """
    folder.mkdir(parents=True, exist_ok=True)
    check_files(folder)
    with (folder / LOCK).open("a+b") as file:
        try:
            if sys.platform == "win32":
                import msvcrt

                msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
            else:
                import fcntl

                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InUse(f"another process is training in {folder}: wait for it, or stop it first") from None
        for path in folder.iterdir():
            if is_draft(path) and path.suffix in _SUFFIXES:
                path.unlink()
            elif path.is_file() and _leads_out(path):  # what is written to a run stays in it
                write_bytes(path.with_name(path.name + COPIED), path.read_bytes())
                os.replace(path.with_name(path.name + COPIED), path)
        yield


def _leads_out(path: Path) -> bool:
    """Whether a link in a run's folder leads to something elsewhere."""
    return path.is_symlink() and Path(os.path.realpath(path.parent)) not in Path(os.path.realpath(path)).parents


def check_files(folder: Path) -> None:
    """Raise a ValueError if something in a run's folder has the name of one of its files and is none.

    That is a folder, a pipe or a device, or a link that leads nowhere. A link to another folder is refused too: what
    is written to a run, which may come from anybody, stays in it.
    """
    for path in folder.iterdir():
        if path.is_dir() and _leads_out(path):
            raise ValueError(f"{path} is a link to a folder elsewhere: remove it, or move that folder here")
        if (path.suffix in _SUFFIXES or path.name == LOCK) and not path.is_file() and os.path.lexists(path):
            raise ValueError(f"{path} is no file: remove it, or restore the file of the run that had this name")


def check_origin(folder: Path, config: TrainingConfig) -> str:
    """Compare a run's settings with those that it began with; device and threads may change.

    A setting that there was not yet when the run began has its default.

    Returns:
        The identity of the run, equal for runs of equal settings, which have equal checkpoints.

    Raises:
        ValueError: if others have changed, with their values, or it is not known what the run began with.
    """
    path = folder / "run.json"
    about = read_document(path)
    began = about.get("config") if isinstance(about, dict) else None
    if not isinstance(began, dict):
        raise ValueError(f"{path} is damaged: it does not have the settings that the run began with; restore it")
    then = TrainingConfig.parse(began, str(path)).model_dump(mode="json")
    now = config.model_dump(mode="json")
    if changed := [line for line in _changes(then, now) if not line.startswith(_FREE)]:
        raise ValueError(
            f"{folder / 'config.yaml'} was edited since the run began ({', '.join(changed[:8])}): a run keeps its "
            f"settings; restore them ({path.name} has them), or begin another run"
        )
    fixed = {name: value for name, value in began.items() if name not in _FREE}
    return hashlib.sha256(json.dumps(fixed, sort_keys=True).encode()).hexdigest()


def _changes(before: Mapping[str, Any], after: Mapping[str, Any], prefix: str = "") -> Iterator[str]:
    """What differs between nested settings, such as ``env_config.horizon: 2.0 was 3.0``."""
    for name in dict.fromkeys((*before, *after)):
        old, new = before.get(name, _ABSENT), after.get(name, _ABSENT)
        if isinstance(old, dict) and isinstance(new, dict):
            yield from _changes(old, new, f"{prefix}{name}.")
        elif old != new:
            yield f"{prefix}{name:.60}: {new!s:.60}, which was {old!s:.60}"
