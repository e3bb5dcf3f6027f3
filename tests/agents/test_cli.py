"""The `planarm` command: help, exit codes, one line for what the user must put right."""

from __future__ import annotations

import subprocess
import sys
from importlib import metadata
from typing import Any

import pytest

from agents.cli import COMMANDS, main
from agents.commands import rollout


def test_help_is_quick_because_it_imports_nothing() -> None:
    program = (
        "import sys\nfrom agents.cli import main\n"
        "try:\n    main(['--help'])\nexcept SystemExit as end:\n    assert end.code == 0\n"
        "heavy = {'numba', 'numpy', 'pymunk', 'scipy', 'gymnasium', 'torch'} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
    )
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    for command in COMMANDS:
        assert command in result.stdout


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_explains_itself(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main([command, "--help"])
    assert end.value.code == 0
    assert f"planarm {command}" in capsys.readouterr().out


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.strip() == f"planarm {metadata.version('planarm')}"


@pytest.mark.parametrize(
    "arguments", [[], ["benchmrak"], ["benchmark", "--episods", "3"], ["benchmark", "--episodes", "many"], ["rollout"]]
)
def test_a_wrong_command_line_ends_with_2(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(arguments)
    assert end.value.code == 2
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["rollout", "ConveyorTrack-v1"], 'did you mean "ConveyorTrack-v0"'),
        (["rollout", "ConveyorTrack-v0", "--policy", "dptc"], 'did you mean "dpct"'),
        (["benchmark", "--config", "none.yaml"], "none.yaml"),
        (["benchmark", "--policies", "dptc"], 'did you mean "dpct"'),
    ],
)
def test_a_users_error_is_one_line_and_2(
    arguments: list[str], complaint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith(f"planarm {arguments[0]}: ")
    assert complaint in captured.err
    assert captured.err.count("\n") == 1


def test_ctrl_c_ends_with_130(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(options: Any) -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr(rollout, "run", interrupted)
    assert main(["rollout", "ConveyorTrack-v0"]) == 130


def test_the_commands_own_exit_code_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[Any] = []
    monkeypatch.setattr(rollout, "run", lambda options: seen.append(options) or 7)
    assert main(["rollout", "ConveyorTrack-v0", "--seed", "4", "--render"]) == 7
    assert (seen[0].seed, seen[0].render) == (4, True)
