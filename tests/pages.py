"""Does what a page of docs/ says, as its reader would: from a folder of one's own, in fresh processes.

A block of code whose first line is a comment with a file's name (``# my_arm.yaml``) is written to that file; a Python
block without one is run, and so is every line of a shell block that begins with ``planarm``, all in the order of the
page.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent
_FILE = re.compile(r"# ([\w-]+\.(?:py|yaml|json))$")


def follow(page: str, folder: Path, *, timeout: float = 240.0) -> str:
    """Follow a page, such as ``extend/policy.md``, in an empty folder; what its commands and programs print."""
    printed = []
    for language, code in re.findall(r"^```(\w+)\n(.*?)^```", (ROOT / "docs" / page).read_text(), re.S | re.M):
        name = _FILE.match(code.partition("\n")[0])
        if name is not None:
            (folder / name[1]).write_text(code)
        elif language == "python":
            printed.append(_run([sys.executable, "-W", "error", "-c", code], folder, timeout))
        elif language == "sh":
            for line in code.replace("\\\n", " ").splitlines():
                if line.startswith("planarm "):
                    command = shlex.split(line, comments=True)[1:]
                    printed.append(_run([sys.executable, "-W", "error", "-m", "agents.cli", *command], folder, timeout))
    return "\n".join(printed)


def _run(command: list[str], folder: Path, timeout: float) -> str:
    """What a command prints; an AssertionError with its messages if it fails."""
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        command,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": path, "OPENBLAS_NUM_THREADS": "1", "SDL_VIDEODRIVER": "dummy"},
        capture_output=True,
        text=True,
        timeout=timeout,
        check=False,
    )
    assert done.returncode == 0, f"{shlex.join(command)}\n{done.stdout}\n{done.stderr}"
    return done.stdout
