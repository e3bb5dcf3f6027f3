"""README, .ci/run, constraints.txt and pyproject.toml agree, README's examples run, the source keeps its structure."""

from __future__ import annotations

import ast
import re
import tomllib
from collections import Counter
from graphlib import TopologicalSorter
from pathlib import Path
from statistics import median
from typing import Any

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import agents
import envs
import planarm

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text()


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", README, flags=re.DOTALL | re.MULTILINE)


def requirements() -> list[Requirement]:
    project: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    lines = project["dependencies"] + [line for extra in project["optional-dependencies"].values() for line in extra]
    return [requirement for requirement in map(Requirement, lines) if requirement.name != "planarm"]


def pins() -> dict[str, str]:
    lines = [line for line in (ROOT / "constraints.txt").read_text().splitlines() if line and not line.startswith("#")]
    return {canonicalize_name(name): version for name, version in (line.split("==") for line in lines)}


def test_readme_has_two_commands_of_one_line_each() -> None:
    run, test = (block.strip() for block in blocks("sh"))
    assert "\n" not in run + test
    assert run.endswith("planarm benchmark")
    assert test.endswith("pytest -n 2")
    assert all(command.startswith("python3 -m venv .venv && .venv/bin/pip install") for command in (run, test))
    assert all("-c constraints.txt -e" in command for command in (run, test))


def test_readme_is_one_screen() -> None:
    assert len(README.splitlines()) <= 120


def test_ci_runs_readmes_test_command() -> None:
    assert blocks("sh")[1] in (ROOT / ".ci" / "run").read_text()


@pytest.mark.parametrize("code", blocks("python"), ids=lambda code: code.splitlines()[-1][:30])
def test_readmes_examples_run(code: str) -> None:
    exec(compile(code, "README.md", "exec"), {})


PAGES = ["README.md", *sorted(path.relative_to(ROOT).as_posix() for path in ROOT.glob("docs/**/*.md"))]


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_somewhere(page: str) -> None:
    for link in re.findall(r"\]\(([^):]+)\)", (ROOT / page).read_text()):
        file, _, heading = link.partition("#")
        target = ROOT / page if not file else (ROOT / page).parent / file
        assert target.is_file(), link
        if heading:
            titles = re.findall(r"^#+ (.*)$", target.read_text(), flags=re.MULTILINE)
            assert heading in [re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles], link


@pytest.mark.parametrize("requirement", requirements(), ids=str)
def test_every_requirement_is_pinned_to_a_version_it_allows(requirement: Requirement) -> None:
    assert requirement.specifier.contains(pins()[canonicalize_name(requirement.name)])


def test_core_installs_no_torch() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert not [line for line in project["dependencies"] if "torch" in line or "stable" in line]


def test_the_version_is_pyprojects() -> None:
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert agents.__version__ == envs.__version__ == planarm.__version__ == version


def test_paths_in_readme_exist() -> None:
    paths = re.findall(r"\b(?:planarm|planners|envs|agents|configs|tests|tools|docs)/[\w/.-]*\w", README)
    assert paths
    assert not [path for path in paths if not (ROOT / path).exists()]


SOURCE = {
    path.relative_to(ROOT).with_suffix("").as_posix().removesuffix("/__init__").replace("/", "."): path
    for floor in ("planarm", "planners", "envs", "agents", "tools")
    for path in sorted((ROOT / floor).rglob("*.py"))
}


def imported(path: Path) -> set[str]:
    """The dotted names of the modules of this repository that a file imports, anywhere in it."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return names & SOURCE.keys()


IMPORTS = {module: imported(path) for module, path in SOURCE.items()}


def imports_between(importer: str, imported: str) -> list[tuple[str, str]]:
    """The imports by which one room, a dotted name, leads into another."""
    return [
        (module, name)
        for module, names in IMPORTS.items()
        for name in names
        if f"{module}.".startswith(f"{importer}.") and f"{name}.".startswith(f"{imported}.")
    ]


METHODS = ("planners.dpct", "planners.lagrange", "planners.apf")
FORBIDDEN = [
    *[("planners", upper) for upper in ("envs", "agents", "planarm", "tools")],
    *[("envs", upper) for upper in ("agents", "planarm", "tools")],
    *[("agents", upper) for upper in ("planarm", "tools")],
    *[(one, other) for one in METHODS for other in METHODS if one != other],
    *[("planners.motion", method) for method in METHODS],
]


@pytest.mark.parametrize(("importer", "imported"), FORBIDDEN, ids=str)
def test_imports_point_down(importer: str, imported: str) -> None:
    assert not imports_between(importer, imported)


def test_agents_import_each_other_over_few_storeys() -> None:
    graph = {module: {name for name in names if name.startswith("agents.")} for module, names in IMPORTS.items()}
    storey: dict[str, int] = {}
    for module in TopologicalSorter(graph).static_order():
        storey[module] = 1 + max((storey[name] for name in graph[module]), default=0)
    assert {module for module in storey if module.startswith("agents.") and storey[module] > 7} == set()


LINES = {path: len(path.read_text().splitlines()) for path in SOURCE.values()}


def test_source_files_are_short() -> None:
    assert median(LINES.values()) <= 150
    assert sorted(LINES.values())[int(0.9 * len(LINES))] <= 320


def test_tests_are_at_least_half_of_the_source() -> None:
    tests = sum(len(path.read_text().splitlines()) for path in (ROOT / "tests").rglob("*.py"))
    assert tests >= 0.5 * sum(LINES.values())


def test_tests_that_need_an_extra_are_marked() -> None:
    needing = [path.read_text() for path in (ROOT / "tests").rglob("test_*.py") if path.name != "test_house.py"]
    assert all("pytest.mark.rl" in text for text in needing if 'importorskip("stable_baselines3"' in text)


def test_folders_are_not_heaps() -> None:
    crowded = {folder: n for folder, n in Counter(path.parent for path in LINES).items() if n > 14}
    assert not crowded


def test_tools_show_their_command() -> None:
    tools = [path for path in (ROOT / "tools").glob("*.py") if "__main__" in path.read_text()]
    assert tools
    silent = [
        path.name
        for path in tools
        if f"python -m tools.{path.stem}" not in str(ast.get_docstring(ast.parse(path.read_text())))
    ]
    assert not silent


def test_an_environment_of_a_batch_is_not_a_lane() -> None:
    files = [*SOURCE.values(), *ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("tests/**/*.py")]
    lane = re.compile(r"\blanes?\b", flags=re.IGNORECASE)
    assert not [path for path in files if path.name != "test_house.py" and lane.search(path.read_text())]


def test_the_tree_in_contributing_exists() -> None:
    _, tree = (ROOT / "CONTRIBUTING.md").read_text().split("## How the code is laid out")
    floor, shown = ROOT, []
    for line in re.findall(r"^ {4,6}\S.*$", tree.split("\n\n")[2], flags=re.MULTILINE):
        names = re.findall(r"[\w.]+/?", re.split(r" {2,}", line.strip())[0])
        if line.startswith("      "):
            shown += [floor / name for name in names]
        else:
            floor = ROOT / names[0]
            shown += [ROOT / name for name in names]
    assert len(shown) > 20
    assert not [path for path in shown if not path.exists()]


def test_the_citation_names_the_version() -> None:
    assert f"version: {agents.__version__}" in (ROOT / "CITATION.cff").read_text()
