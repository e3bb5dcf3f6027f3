"""The `planarm` command: help, exit codes, one line for what the user must put right."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from importlib import import_module, metadata
from pathlib import Path
from typing import Any

import gymnasium as gym
import numba
import pytest

import agents
import envs
from agents import console
from agents.cli import COMMANDS, main
from agents.commands import rollout
from agents.console import catch_interrupt, note_compiling


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
    out = capsys.readouterr().out
    assert f"usage: planarm {command}" in out
    assert f"$ planarm {command}" in out  # at least one example
    assert "default: " in out or "subcommands" in out


@pytest.mark.parametrize("arguments", [["--help"], *([command, "--help"] for command in COMMANDS)], ids=" ".join)
def test_help_fits_the_terminal(
    arguments: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    with pytest.raises(SystemExit):
        main(arguments)
    out = capsys.readouterr().out
    assert max(map(len, out.splitlines())) <= 80
    if arguments == ["--help"]:
        assert "Exit codes: 0 done; 1 an output" in out


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


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupt_that_a_command_hands_on_keeps_its_exit_code(
    number: signal.Signals, code: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(options: Any) -> int:
        with catch_interrupt(at_once=True):
            signal.raise_signal(number)
        return 0

    monkeypatch.setattr(rollout, "run", interrupted)
    assert main(["rollout", "ConveyorTrack-v0"]) == code


def test_the_commands_own_exit_code_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[Any] = []
    monkeypatch.setattr(rollout, "run", lambda options: seen.append(options) or 7)
    assert main(["rollout", "ConveyorTrack-v0", "--seed", "4", "--render"]) == 7
    assert (seen[0].seed, seen[0].render) == (4, True)


def planarm(*arguments: str, **env: str) -> subprocess.CompletedProcess[str]:
    """Run the command in a fresh process."""
    command = [sys.executable, "-m", "agents.cli", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, **env})


def test_help_can_be_printed_where_only_ascii_can() -> None:
    result = planarm("--help", PYTHONIOENCODING="ascii")
    assert result.returncode == 0, result.stderr
    assert "planarm benchmark" in result.stdout


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize("arguments", [["--version"], ["--help"], ["list"]], ids=" ".join)
def test_an_output_that_is_full_is_one_line_and_1(arguments: list[str]) -> None:
    with Path("/dev/full").open("w") as full:
        command = [sys.executable, "-m", "agents.cli", *arguments]
        result = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert result.returncode == 1
    assert result.stderr.strip().endswith("cannot print: No space left on device")
    assert result.stderr.count("\n") == 1


def test_a_file_that_does_not_fit_is_one_line_and_1(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list", "--json", "/dev/full"]) == 1
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err == "planarm list: cannot write /dev/full: No space left on device\n"


def test_closed_outputs_are_no_error() -> None:
    command = [sys.executable, "-m", "agents.cli", "plan", "--list"]
    assert subprocess.run(["sh", "-c", 'exec "$@" >&- 2>&-', "sh", *command], check=False).returncode == 0


def test_json_is_written_even_if_nobody_reads_the_tables(tmp_path: Path) -> None:
    path = tmp_path / "scores.json"
    command = [sys.executable, "-m", "agents.cli", "evaluate", "follower", "--env", "ConveyorTrack-v0"]
    reader, writer = os.pipe()
    os.close(reader)
    result = subprocess.run([*command, "--episodes", "2", "--json", str(path)], stdout=writer, stderr=subprocess.PIPE)
    os.close(writer)
    assert json.loads(path.read_text())["complete"] is True
    assert result.returncode == 1
    assert b"Traceback" not in result.stderr


@pytest.mark.parametrize(
    "arguments",
    [
        ["evaluate", "dpct", "--env", "ConveyorTrack-v0", "--json"],
        ["benchmark", "--json"],
        ["rollout", "ConveyorTrack-v0", "--record"],
        ["paths", "ConveyorTrack-v0", "--plot"],
        ["paper-dpct", "--json"],
    ],
)
def test_a_file_that_cannot_be_written_is_said_before_the_work(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(import_module(COMMANDS[arguments[0]].module), "run", lambda options: pytest.fail("it ran"))
    (tmp_path / "file").write_text("no folder")
    assert main([*arguments, str(tmp_path / "file" / "out.png")]) == 2
    assert capsys.readouterr().err.startswith(f"planarm {arguments[0]}: cannot write ")


def test_compiling_is_said_once_and_then_how_far_it_is(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def compile_two() -> None:
        for _ in range(2):
            numba.njit(lambda x: x + 1)(2)

    with note_compiling():
        compile_two()
    compile_two()
    assert capsys.readouterr().err == "compiling, once; later runs load it\n"
    monkeypatch.setattr(console, "INTERVAL", 0.0)
    with note_compiling():
        compile_two()
    assert capsys.readouterr().err.splitlines()[1] == "compiling, once: 2 functions"


def test_a_progress_bar_shows_what_is_compiled() -> None:
    bar = console.progress_bar("episodes")
    bar.disable = False
    task = bar.add_task("")
    with note_compiling(), console.show_compiling(bar) as begin:
        begin("ConveyorTrack-v0")
        numba.njit(lambda x: x + 1)(2)
        assert bar.tasks[task].description == "ConveyorTrack-v0: compiling, once"
        begin("ConveyorTrack-v0: dpct")
        assert bar.tasks[task].description == "ConveyorTrack-v0: dpct"


def test_a_window_needs_a_display(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    assert main(["rollout", "ConveyorTrack-v0", "--render"]) == 2
    assert "--render needs a display" in capsys.readouterr().err


def test_a_task_of_ones_own_in_every_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "slow_belt.py").write_text(
        "import envs\nfrom envs.conveyor_track.env import ConveyorTrack\n\n\n"
        "class SlowBelt(ConveyorTrack):\n    env_id = 'SlowBelt-v0'\n\n\n"
        "envs.register('SlowBelt-v0', SlowBelt, envs.task_card('ConveyorTrack-v0'))\n"
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    name, few = "slow_belt:SlowBelt-v0", ["--episodes", "2"]
    try:
        for arguments in (
            ["list", name],
            ["benchmark", "--tasks", name, "--policies", "dpct", "random", "--bound-episodes", "0", *few],
            ["evaluate", "follower", "--env", name, *few],
            ["rollout", name, "--policy", "follower", "--options", "belt_speed=0.15"],
            ["paths", name, "--policies", "follower"],
        ):
            assert main(arguments) == 0, arguments
            assert "SlowBelt-v0" in capsys.readouterr().out
        assert agents.evaluate("follower", name, [0]).env_id == "SlowBelt-v0"
    finally:
        sys.modules.pop("slow_belt", None)
        gym.registry.pop("SlowBelt-v0", None)
        envs.card._CARDS.pop("SlowBelt-v0", None)


def test_ctrl_c_in_compiled_code_is_ctrl_c(monkeypatch: pytest.MonkeyPatch) -> None:
    def in_compiled_code(options: Any) -> int:
        raise SystemError("returned a result with an exception set") from KeyboardInterrupt()

    monkeypatch.setattr(rollout, "run", in_compiled_code)
    assert main(["rollout", "ConveyorTrack-v0"]) == 130
    with pytest.raises(KeyboardInterrupt), catch_interrupt(at_once=True):
        in_compiled_code(None)
    with pytest.raises(SystemError, match="another"), catch_interrupt(at_once=True):
        raise SystemError("another")


def test_ctrl_c_that_the_compiler_turns_into_an_error_is_ctrl_c() -> None:
    def in_the_compiler() -> None:
        with contextlib.suppress(KeyboardInterrupt):  # in a callback from C
            signal.raise_signal(signal.SIGINT)
        raise RuntimeError("no compiled object yet")

    with pytest.raises(KeyboardInterrupt), catch_interrupt(at_once=True):
        in_the_compiler()
    with pytest.raises(RuntimeError, match="another"), catch_interrupt(at_once=True):
        raise RuntimeError("another")


def test_ctrl_c_is_answered_within_a_second(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "agents.cli", "evaluate", "dpct", "--env", "ConveyorTrack-v0"]
    arguments = ["--against", "random", "--episodes", "20000", "--num-envs", "8"]
    with subprocess.Popen([*command, *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as process:
        time.sleep(8.0)
        process.send_signal(signal.SIGINT)
        assert process.stderr is not None
        began = time.monotonic()
        said = process.stderr.readline()
        waited = time.monotonic() - began
        process.stderr.read()
    assert b"interrupted" in said or process.returncode == 130
    assert process.returncode == 130
    assert waited < 1.0


@pytest.mark.parametrize("file", ["numba/core/serialize.py", "<string>"])
def test_ctrl_c_waits_while_numba_converts_a_result(file: str) -> None:
    passed: list[str] = []
    names = {"signal": signal, "passed": passed}
    code = "def convert():\n    signal.raise_signal(signal.SIGINT)\n    passed.append('converted')\n"
    exec(compile(code, file, "exec"), names)

    def call() -> None:
        names["convert"]()  # type: ignore[operator]
        passed.append(str(len("more")))

    with pytest.raises(KeyboardInterrupt), catch_interrupt(at_once=True):
        call()
    assert passed == ["converted"]


def test_an_interrupt_waits_for_the_end_of_what_llvm_calls() -> None:
    """It would drop the exception, and the command would go on."""
    reached = []

    def _raw_object_cache_notify() -> None:
        signal.raise_signal(signal.SIGTERM)
        reached.append("end")

    def command() -> None:
        _raw_object_cache_notify()
        reached.append("too far")

    with pytest.raises(KeyboardInterrupt), catch_interrupt(at_once=True):
        command()
    assert reached == ["end"]
