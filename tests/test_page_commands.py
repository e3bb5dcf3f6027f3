"""Every command and every Python block of README.md and docs/ works: ``pytest -m docs``.

Notebooks run when the site is built.

Each page has a process of its own, in a folder with the files that the pages show. A command runs as it is printed, but
for the sizes below; one that trains or serves for minutes is carried out up to there: its line is parsed, what it names
is read and checked. Tools of maintainers are parsed.
"""

from __future__ import annotations

import importlib.util
import json
import re
import shlex
import shutil
import sys
from pathlib import Path

import pytest

from tests.pages import ROOT, Step, pages, run, steps

pytestmark = [
    pytest.mark.docs,
    pytest.mark.skipif(importlib.util.find_spec("stable_baselines3") is None, reason="pages train: needs the extra rl"),
]
NOTEBOOKS = sorted((ROOT / "docs").rglob("*.ipynb"))

CHECKED = {
    "train": "trains for minutes",
    "play": "serves until Ctrl-C",
    "sweep": "needs Ray, and trains for minutes",
}
"""Commands that are not carried out to their end, with the reason."""

CHECKED_LINES = {
    "benchmark --address auto": "needs a Ray cluster",
    "evaluate runs/... --env circle_task:Circle-v0 --against follower": "the run's name holds its date",
    "rollout my_task:Swing-v0": "stands for a task of the reader's",
}
"""Lines that are only parsed, with the reason."""

TRAINED = "extend/algorithm.md"
"""The page whose training runs: it is made to be tried, and what it leaves serves the other pages."""

OTHER_LIBRARIES = ("ray", "torchrl", "minari")
"""Blocks that import one of them are left out where it is not installed; ``pytest -m clients`` runs them."""

STAND_INS = {"FOLDER": "runs/mine", "FILE": "report.html", "$seed": "0", "my_module:": "my_policy:"}
"""What the pages leave to the reader, and what stands for it here."""

SIZES = {"--episodes": 2, "--bound-episodes": 1, "--fps": 2, "--width": 160}
"""The largest value of an option here, where a page has a larger one."""
ALWAYS = {
    "benchmark": {"--episodes": 2, "--bound-episodes": 0, "--replays": 1},
    "evaluate": {"--episodes": 2},
    "paper-excavator": {"--cycles": 1},
}
"""Options given here where a page leaves them out, and their defaults are large."""
FILMS = {"--fps": 2, "--width": 160}
"""The same for what ends with ``.gif``."""


def smaller(command: str) -> list[str]:
    """A command with the sizes above."""
    words = shlex.split(command)
    for option, most in SIZES.items():
        if option in words:
            place = words.index(option) + 1
            words[place] = str(min(int(words[place]), most))
    given = {**ALWAYS.get(words[0], {}), **(FILMS if words[0] == "rollout" and command.endswith(".gif") else {})}
    if words[0] == "benchmark" and "--tasks" not in words and "--config" not in words and "--help" not in words:
        given["--tasks"] = "ConveyorTrack-v0"
    for option, value in given.items():
        if option not in words:
            words += [option, str(value)]
    return words


def carried_out(page: str, step: Step, folder: Path) -> dict[str, object]:
    """A step as the runner takes it."""
    text = step.text
    for name, stand_in in STAND_INS.items():
        text = text.replace(name, stand_in)
    whole = True
    if step.kind == "planarm":
        name = text.split()[0]
        whole = text not in CHECKED_LINES and (
            name not in CHECKED or "--help" in text or (page.endswith(TRAINED) and step.shown == "block")
        )
        words = smaller(text) if whole else shlex.split(text)
        if len(words) == 1 and step.shown == "inline" and name not in ("list", "benchmark", "play"):
            words, whole = [name, "--help"], True  # the name of a command inside a sentence
        text = shlex.join(word for given in words for word in expanded(given, folder))
    return {"kind": step.kind, "text": text, "name": step.name, "whole": whole}


def expanded(word: str, folder: Path) -> list[str]:
    """A pattern of file names as a shell expands it."""
    return [str(path.relative_to(folder)) for path in sorted(folder.glob(word))] if word.endswith("*") else [word]


@pytest.fixture(scope="session")
def material(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with every file that the pages show, a short run and a model of Stable-Baselines3."""
    folder = tmp_path_factory.mktemp("material")
    for page in pages():
        for step in steps((ROOT / page).read_text()):
            if step.kind == "file":
                (folder / step.name).write_text(step.text)
    do(f"docs/{TRAINED}", folder)
    for task in ("belt", "move", "dodge", "load"):  # as docs/agents calls the runs of its tasks
        shutil.copytree(folder / "runs" / "mine", folder / "runs" / f"{task}-0")
    do("docs/benchmark/report.md", folder)
    return folder


DONE: set[str] = set()
"""What has been done: it is not done again for another page, whose files are the same."""


def missing(step: Step) -> bool:
    """Whether a Python block needs one of the other libraries, and that is not installed."""
    imported = set(re.findall(r"^(?:from|import) (\w+)", step.text, re.M)) if step.kind == "python" else set()
    return any(importlib.util.find_spec(name) is None for name in imported & set(OTHER_LIBRARIES))


def do(page: str, folder: Path) -> None:
    """Do what a page says, in a folder."""
    (folder / "docs" / "pictures").mkdir(parents=True, exist_ok=True)
    todo = []
    for step in steps((ROOT / page).read_text()):
        entry = carried_out(page, step, folder)
        key = json.dumps(entry)
        if (step.kind != "file" and key in DONE) or missing(step):
            continue
        DONE.add(key)
        todo.append(entry)
    (folder / "steps.json").write_text(json.dumps(todo))
    run([sys.executable, "-W", "error", str(ROOT / "tests" / "page_runner.py"), "steps.json"], folder, 600.0)


@pytest.mark.parametrize("page", [page for page in pages() if any(steps((ROOT / page).read_text()))])
def test_what_a_page_says_works(page: str, material: Path, tmp_path: Path) -> None:
    folder = tmp_path / "reader"
    shutil.copytree(material, folder)
    do(page, folder)


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_stored_without_outputs(notebook: Path) -> None:
    cells = [cell for cell in json.loads(notebook.read_text())["cells"] if cell["cell_type"] == "code"]
    assert cells
    assert not any(cell["outputs"] or cell["execution_count"] for cell in cells)


def test_exceptions_are_of_lines_that_exist() -> None:
    lines = {step.text for page in pages() for step in steps((ROOT / page).read_text())}
    assert set(CHECKED_LINES) <= lines


def test_a_wrong_name_or_option_on_a_page_fails(tmp_path: Path) -> None:
    for command in ("train ppo/ConveyorTrack-v0 gama=0.9", "play Conveyor-v0"):
        step = {"kind": "planarm", "text": command, "name": "", "whole": False}
        (tmp_path / "steps.json").write_text(json.dumps([step]))
        with pytest.raises(AssertionError, match=re.escape(command)):
            run([sys.executable, str(ROOT / "tests" / "page_runner.py"), "steps.json"], tmp_path, 60.0)
