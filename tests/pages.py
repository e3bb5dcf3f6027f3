"""What a page of docs/ tells its reader to do, and doing it: from a folder of one's own, in fresh processes.

A block of code whose first line is a comment with a file's name (``# my_arm.yaml``) is written to that file; a Python
block without one is run, and so is every command ``planarm ...`` of a shell block, in the order of the page. `steps`
also finds the commands of indented blocks and inside lines, and those of ``tools``.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Literal, NamedTuple

ROOT = Path(__file__).parent.parent
_FILE = re.compile(r"# ([\w-]+\.(?:py|yaml|json))$")
_BLOCK = re.compile(
    r"^```(\w+)\n(.*?)^```|((?:^ {4}\S[^\n]*\n(?:^ {6}[^\n]*\n)*)+)|(?<!`)`((?:[^`\n]|\n(?!\n))+)`(?!`)", re.S | re.M
)
_COMMAND = re.compile(r"(?:^|do |&& )(?:\.venv/bin/)?(planarm|python -m tools[.\w]+)(?=\s|$)([^;|>]*)")


class Step(NamedTuple):
    """One thing to do: a file to write, Python code to run, or a command (without ``planarm`` or ``python -m``)."""

    kind: Literal["file", "python", "planarm", "tool"]
    text: str
    name: str = ""  # of the file; for a tool its module
    shown: Literal["block", "indented", "inline"] = "block"


def pages() -> list[str]:
    """Every page there is, README first, relative to the root."""
    return ["README.md", *(str(path.relative_to(ROOT)) for path in sorted((ROOT / "docs").rglob("*.md")))]


def steps(text: str) -> Iterator[Step]:
    """What a page says to do, in its order."""
    for language, code, indented, inline in _BLOCK.findall(text):
        name = _FILE.match(code.partition("\n")[0])
        if name is not None:
            yield Step("file", code, name[1])
        elif language == "python":
            yield Step("python", code)
        elif language == "sh":
            yield from _commands(code, "block")
        elif indented:
            yield from _commands(re.sub(r"^ {4}", "", indented, flags=re.M), "indented")
        elif inline:
            yield from _commands(" ".join(inline.replace("\\\n", " ").split()), "inline")


def _commands(text: str, shown: Literal["block", "indented", "inline"]) -> Iterator[Step]:
    for line in text.replace("\\\n", " ").splitlines():
        for program, arguments in _COMMAND.findall(re.sub(r"(?:^|\s)#.*", "", line)):
            if program == "planarm" and arguments.strip():
                yield Step("planarm", arguments.strip(), shown=shown)
            elif program != "planarm":
                yield Step("tool", arguments.strip(), program.removeprefix("python -m "), shown)


def follow(page: str, folder: Path, *, timeout: float = 240.0) -> str:
    """Follow a page, such as ``extend/policy.md``, in an empty folder; what its commands and programs print."""
    printed = []
    for step in steps((ROOT / "docs" / page).read_text()):
        if step.shown != "block":
            continue
        if step.kind == "file":
            (folder / step.name).write_text(step.text)
        elif step.kind == "python":
            printed.append(run([sys.executable, "-W", "error", "-c", step.text], folder, timeout))
        elif step.kind == "planarm":
            command = [sys.executable, "-W", "error", "-m", "agents.cli", *shlex.split(step.text)]
            printed.append(run(command, folder, timeout))
    return "\n".join(printed)


def run(command: list[str], folder: Path, timeout: float) -> str:
    """What a command prints; an AssertionError with its messages if it fails."""
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        command,
        cwd=folder,
        env={
            **os.environ,
            "PYTHONPATH": path,
            "OPENBLAS_NUM_THREADS": "1",
            "SDL_VIDEODRIVER": "dummy",
            "MINARI_DATASETS_PATH": str(folder / "datasets"),
        },
        capture_output=True,
        text=True,
        timeout=timeout,
        check=False,
    )
    assert done.returncode == 0, f"{shlex.join(command)}\n{done.stdout}\n{done.stderr}"
    return done.stdout
