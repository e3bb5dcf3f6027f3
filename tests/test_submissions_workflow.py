"""What the workflow of submissions takes from a pull request: the folders that it changes, and nothing else."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parent.parent
SCRIPT = ROOT / ".ci" / "submissions"

pytestmark = pytest.mark.skipif(
    sys.platform == "win32" or shutil.which("git") is None or shutil.which("bash") is None, reason="needs bash and git"
)


class Repository:
    """A repository with a base commit, and a command `planarm` that prints its arguments and the files it is given."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.out = folder / "repository", folder / "out"
        tools = folder / "bin"
        tools.mkdir()
        (tools / "planarm").write_text('#!/bin/sh\necho "$@"\ncd "$3" && find . -type f | sort\nexit 1\n')
        (tools / "planarm").chmod(0o755)
        who = {f"GIT_{role}_{what}": "a@b" for role in ("AUTHOR", "COMMITTER") for what in ("NAME", "EMAIL")}
        path = os.pathsep.join([str(tools), os.environ["PATH"]])
        self._environment = {**os.environ, **who, "PATH": path, "GIT_CONFIG_GLOBAL": os.devnull}
        self.folder.mkdir()
        self.git("init", "--quiet", "--initial-branch", "main")
        self.write("submissions/README.md", "how")
        self.write("submissions/old/card.yaml", "old")
        self.commit()
        self.git("checkout", "--quiet", "-b", "theirs")

    def git(self, *arguments: str) -> None:
        subprocess.run(["git", *arguments], cwd=self.folder, env=self._environment, check=True, capture_output=True)

    def write(self, name: str, text: str) -> None:
        (self.folder / name).parent.mkdir(parents=True, exist_ok=True)
        (self.folder / name).write_text(text)

    def commit(self) -> None:
        self.git("add", "-A")
        self.git("commit", "--quiet", "-m", "some")

    def check(self) -> subprocess.CompletedProcess[str]:
        """What the script does with what has been written since the base."""
        self.commit()
        command = ["bash", str(SCRIPT), "main", "theirs", str(self.out), "--format", "markdown"]
        return subprocess.run(
            command, cwd=self.folder, env=self._environment, capture_output=True, text=True, check=False
        )


@pytest.fixture
def repository(tmp_path: Path) -> Repository:
    return Repository(tmp_path)


def test_the_folders_that_differ_are_checked_and_nothing_else_is_taken(repository: Repository) -> None:
    repository.write("submissions/mine/card.yaml", "mine")
    repository.write("agents/evil.py", "print()")
    repository.write("submissions/README.md", "changed")
    done = repository.check()
    mine = f"{repository.out}/submissions/mine"
    assert done.stdout.splitlines() == [f"submit check {mine} --format markdown", "./card.yaml"]
    assert done.returncode == 1  # planarm's
    assert [path.name for path in repository.out.rglob("*") if path.is_file()] == ["card.yaml"]


def test_nothing_is_checked_where_nothing_is_submitted(repository: Repository) -> None:
    repository.write("README.md", "changed")
    shutil.rmtree(repository.folder / "submissions" / "old")
    done = repository.check()
    assert (done.returncode, done.stdout) == (0, "submissions/old is removed\n")


@pytest.mark.parametrize("name", ["Mine", "a b", "$(id)", "-x", "a\nb", "é"])
def test_strange_names_are_refused(repository: Repository, name: str) -> None:
    repository.write(f"submissions/{name}/card.yaml", "mine")
    done = repository.check()
    assert (done.returncode, done.stdout) == (1, "")
    assert "the name of a folder has up to 40 of the characters" in done.stderr


def test_a_link_in_place_of_a_folder_is_refused(repository: Repository) -> None:
    (repository.folder / "submissions" / "mine").symlink_to("/etc")
    done = repository.check()
    assert (done.returncode, done.stderr) == (1, "submissions/mine is a link, not a folder\n")


def test_the_secret_is_in_the_run_that_a_maintainer_starts_alone() -> None:
    workflow = yaml.safe_load((ROOT / ".github" / "workflows" / "submissions.yml").read_text())
    public, hidden = workflow["jobs"]["public"], workflow["jobs"]["sealed"]
    assert "secrets." not in str(public)
    assert (hidden["if"], hidden["environment"]) == ("github.event_name == 'workflow_dispatch'", "sealed-list")
    assert public["steps"][0]["with"]["ref"] == "${{ github.event.pull_request.base.sha }}"
    for job in (public, hidden):
        assert all(step["shell"] == "bash" for step in job["steps"] if "|" in step.get("run", ""))  # pipefail
        assert "${{" not in "".join(step.get("run", "") for step in job["steps"])
