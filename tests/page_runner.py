"""``python tests/page_runner.py STEPS.json`` does the steps of a page in one process, in the present folder.

``planarm play`` ends before it serves and ``planarm train`` before it trains where the step is only to be checked; then
all else that they do with their options is done. Tools are parsed only.
"""

from __future__ import annotations

import importlib.util
import json
import os
import runpy
import shlex
import sys
from pathlib import Path
from typing import Any
from unittest.mock import patch

import tyro

import agents.cli

PARSED = 3  # the exit code of a command whose line is in order, and which was not run


def planarm(arguments: list[str], *, whole: bool) -> int:
    """Run a command; if not ``whole``, check its command line with all that is named on it, without doing the work."""
    if whole:
        return agents.cli.main(arguments)
    if arguments[0] == "train" and "--resume" not in arguments:
        options = agents.cli._parse(arguments, "train")
        options.resolve()  # reads the recipe, checks every setting that is changed
        return 0
    if arguments[0] == "play":
        with patch("uvicorn.Server.run"), patch("webbrowser.open"):
            return 0 if agents.cli.main([*arguments, "--no-browser"]) == 130 else 1
    with patch("agents.cli._run", return_value=0):
        return agents.cli.main(arguments)


def tool(module: str, arguments: list[str]) -> int:
    """Parse the command line of a tool, without running it; one that takes no options must only be there."""
    source = importlib.util.find_spec(module)
    if source is None or source.origin is None:
        return 1
    if not arguments and not source.submodule_search_locations and "cli(" not in Path(source.origin).read_text():
        return 0
    parse = tyro.cli

    def parse_only(*args: Any, **kwargs: Any) -> None:
        parse(*args, **kwargs)
        raise SystemExit(PARSED)

    sys.modules.pop(module, None)
    with patch("tyro.cli", parse_only), patch("sys.argv", [module, *arguments]):
        try:
            runpy.run_module(module, run_name="__main__", alter_sys=True)
        except SystemExit as error:
            return 0 if error.code == PARSED else 1
    return 1


def main(path: str) -> int:
    """Do the steps; 1 at the first that fails."""
    sys.path.insert(0, os.getcwd())
    for step in json.loads(Path(path).read_text()):
        print(f">>> {step['kind']}: {step['text']}", flush=True)
        match step["kind"]:
            case "file":
                Path(step["name"]).write_text(step["text"])
            case "python":
                exec(compile(step["text"], "page", "exec"), {"__name__": "__main__"})
            case "planarm":
                if planarm(shlex.split(step["text"]), whole=step["whole"]) != 0:
                    return 1
            case "tool":
                if tool(step["name"], shlex.split(step["text"])) != 0:
                    return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
