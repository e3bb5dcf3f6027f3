"""``import planarm`` and the command find planarm's own packages, or say who is in the way."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import agents
import envs
import planarm
import planners
from planarm.names import check_names

ROOT = Path(planarm.__file__).parent.parent
PACKAGES = ("planarm", "planners", "envs", "agents", "configs")


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which planarm is installed as from a wheel."""
    site = tmp_path_factory.mktemp("site")
    for name in PACKAGES:
        shutil.copytree(ROOT / name, site / name, ignore=shutil.ignore_patterns("__pycache__"))
    record(site, "planarm-0.1.0", [path for name in PACKAGES for path in (site / name).rglob("*") if path.is_file()])
    return site


@pytest.fixture
def site(installed: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(installed, tmp_path / "site"))


def record(site: Path, distribution: str, files: list[Path]) -> None:
    """The list of installed files that pip writes."""
    folder = site / f"{distribution}.dist-info"
    folder.mkdir()
    name, _, version = distribution.partition("-")
    (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    lines = [f"{path.relative_to(site).as_posix()},sha256=x,{path.stat().st_size}" for path in files]
    (folder / "RECORD").write_text("\n".join([*lines, f"{folder.name}/RECORD,,"]) + "\n")


def python(site: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(site)}
    folder = site.parent / "work"
    folder.mkdir(exist_ok=True)
    return subprocess.run(
        [sys.executable, *arguments], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )


def refusal(site: Path) -> str:
    """What the import says, after the command has said the same in one line."""
    command = python(site, "-m", "planarm", "--version")
    assert (command.returncode, command.stdout) == (2, "")
    imported = python(site, "-c", "import planarm").stderr
    assert imported.splitlines()[-1] == f"ImportError: {command.stderr.strip().removeprefix('planarm: ')}"
    return command.stderr


def test_the_import_gives_the_packages_and_registers_the_environments(site: Path) -> None:
    done = python(
        site,
        "-c",
        "import planarm, gymnasium, sys; assert 'planners' not in sys.modules\n"
        "print(planarm.__version__, 'ConveyorTrack-v0' in gymnasium.registry, planarm.planners.SCARA_1M.n_joints)",
    )
    assert done.stdout == f"{agents.__version__} True 2\n", done.stderr
    assert (planarm.envs, planarm.planners, planarm.agents) == (envs, planners, agents)
    with pytest.raises(AttributeError, match="'planarm' has no attribute 'env'"):
        planarm.env  # noqa: B018


def test_an_environment_is_made_without_an_import() -> None:
    assert gym.make("planarm:ConveyorTrack-v0").unwrapped.spec is not None
    assert gym.make_vec("planarm:ConveyorTrack-v0", num_envs=2).num_envs == 2


def test_the_command_is_a_module_too(site: Path) -> None:
    assert python(site, "-m", "planarm", "--version").stdout == f"planarm {agents.__version__}\n"


@pytest.mark.skipif(os.name != "posix", reason="sends the signal of Ctrl-C")
def test_an_interrupt_while_the_command_begins_ends_it_without_a_traceback(site: Path) -> None:
    (site / "planarm" / "names.py").write_text("import os, signal\nos.kill(os.getpid(), signal.SIGINT)\n")
    arguments = "import os, signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
    command = python(site, "-c", f"{arguments}os.execv({sys.executable!r}, ['python', '-m', 'planarm', 'list'])")
    assert (command.returncode, command.stdout, command.stderr) == (-signal.SIGINT, "", "")
    imported = python(site, "-c", f"{arguments}import planarm")
    assert imported.stderr.endswith("KeyboardInterrupt\n")


@pytest.mark.parametrize("name", ["envs/__init__.py", "planners.py", "agents/__init__.py"])
def test_a_module_of_the_users_with_the_same_name_is_named(site: Path, name: str) -> None:
    hiding = site.parent / "work" / name
    hiding.parent.mkdir(parents=True)
    hiding.touch()
    said = refusal(site)
    package = name.split("/")[0]
    assert f"{site.parent / 'work' / package} hides planarm's package '{package.removesuffix('.py')}'" in said
    assert "rename it, or run from another folder" in said


def test_a_folder_of_the_users_that_is_no_package_hides_nothing(site: Path) -> None:
    (site.parent / "work" / "envs").mkdir(parents=True)
    (site.parent / "work" / "configs").mkdir()
    assert python(site, "-c", "import planarm").returncode == 0


@pytest.mark.parametrize("name", ["agents/__init__.py", "configs/benchmark.yaml"])
def test_a_distribution_that_overwrote_files_is_named(site: Path, name: str) -> None:
    (site / name).write_text("")
    record(site, "openai_agents-0.9", [site / name])
    said = refusal(site)
    assert f"openai_agents 0.9 has overwritten planarm's {site / name}" in said
    assert "virtual environment of its own" in said


def test_a_distribution_that_is_overwritten_by_planarm_hinders_nothing(site: Path) -> None:
    record(site, "openai_agents-0.9", [site / "agents" / "__init__.py"])
    assert python(site, "-c", "import planarm").returncode == 0


@pytest.mark.parametrize("name", ["agents/__init__.py", "envs/card.py"])
def test_missing_files_are_named(site: Path, name: str) -> None:
    (site / name).unlink()
    assert "install planarm again" in refusal(site)


def test_installed_files_may_be_edited(site: Path) -> None:
    (site / "envs" / "card.py").write_text((site / "envs" / "card.py").read_text() + "# mine\n")
    assert python(site, "-c", "import planarm").returncode == 0


def test_the_check_takes_less_time_than_reading_the_files() -> None:
    def seconds(work: Callable[[], object]) -> float:
        start = time.process_time()
        work()
        return time.process_time() - start

    def read() -> None:
        for name in PACKAGES:
            for path in (ROOT / name).rglob("*.py"):
                path.read_bytes()

    check, reading = np.transpose([(seconds(check_names), seconds(read)) for _ in range(5)]).min(axis=1)
    assert check < reading


def test_the_wheel_has_every_package_and_their_types() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert sorted(project["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]) == sorted(PACKAGES)
    assert all((ROOT / name / "py.typed").is_file() for name in PACKAGES if name != "configs")
