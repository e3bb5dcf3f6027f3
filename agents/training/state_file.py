"""Files with the state of a run: written whole, checked before anything in them is used, read without pickle."""

from __future__ import annotations

import io
import warnings
import zipfile
from pathlib import Path
from typing import Any

import torch

from planners.files import write_bytes

State = dict[str, Any]


def write_state(path: Path, run: str, state: State) -> None:
    """Write the state of the run with this identity, in the types that torch loads without running code."""
    content = io.BytesIO()  # torch has errors of its own for a full disk
    torch.save({**state, "run": run}, content)
    write_bytes(path, content.getbuffer())


def read_state(path: Path, run: str, device: Any = "cpu") -> State:
    """The state that a file of `write_state` holds, its tensors on ``device``. No code in it is run.

    Raises:
        ValueError: if the file cannot be read, is damaged, or is of a run with another identity.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            entries = archive.infolist()
            if any(entry.compress_type != zipfile.ZIP_STORED for entry in entries) or archive.testzip() is not None:
                raise zipfile.BadZipFile  # torch does not compare checksums itself
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            state: State = torch.load(path, weights_only=True, map_location=device)
        if state["run"] != run:
            raise ValueError
    except OSError as error:
        raise ValueError(f"cannot read {path}: {error.strerror or error}") from None
    except Exception as error:  # a damaged file can fail in any way
        raise damaged(path, error) from None
    return state


def damaged(path: Path, error: Exception) -> ValueError:
    """What to raise for a file of a run that cannot be used, without torch's advice to load it unsafely."""
    previous = path.with_name("previous.pt")
    rest = "begin again"
    if path.name == "checkpoint.pt" and previous.exists():
        rest = f"go on from the checkpoint before it, {previous.name}"
    return ValueError(
        f"{path} is damaged, or of another run or version ({type(error).__name__}); restore it, or delete it to {rest}"
    )
