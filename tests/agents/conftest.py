from __future__ import annotations

import builtins
import json
from contextlib import redirect_stdout
from functools import cache
from io import StringIO
from typing import Any

import pytest
from paper_results import PaperResults, Regenerate

from agents.cli import main

QUICK = {"paper-excavator": ["--payloads", "0", "10", "--cycles", "1", "--rate", "40"]}


@pytest.fixture(scope="session")
def regenerate(tmp_path_factory: pytest.TempPathFactory) -> Regenerate:
    """Runs a paper's command, each once in a session, with fewer random problems or cycles than by default."""

    @cache
    def run(command: str) -> PaperResults:
        folder = tmp_path_factory.mktemp("paper") / "new"
        files = ["--json", str(folder / "results.json"), "--plot", str(folder / "figures.png"), "--dpi", "40"]
        with pytest.MonkeyPatch.context() as patch, redirect_stdout(StringIO()) as printed:
            patch.setattr("agents.papers.apf.command.RANDOM_PROBLEMS", 200)
            assert main([command, *files, *QUICK.get(command, [])]) == 0
        return PaperResults(folder, json.loads((folder / "results.json").read_text()), printed.getvalue())

    return run


@pytest.fixture(scope="session")
def scored() -> dict[str, Any]:
    """The document of a small benchmark with replays, one of whose policies has a hostile name."""
    from report_cases import small_benchmark

    return small_benchmark()


@pytest.fixture
def without_matplotlib(monkeypatch: pytest.MonkeyPatch) -> None:
    """Importing matplotlib fails, as where it is not installed."""
    real_import = builtins.__import__

    def no_matplotlib(name: str, *args: Any) -> Any:
        if name.startswith("matplotlib"):
            raise ModuleNotFoundError(name)
        return real_import(name, *args)

    monkeypatch.setattr(builtins, "__import__", no_matplotlib)
