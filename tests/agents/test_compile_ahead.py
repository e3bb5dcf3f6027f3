"""Compiling on two processors: who runs which job, that times are measured alone, and that nothing is left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numba
import pytest

from agents import compile_ahead
from agents.cli import main
from agents.compile_ahead import CompileAhead, Job
from agents.evaluation import benchmark
from agents.evaluation.benchmark_config import configure

MODULE = """
import pathlib, time
import numba

def write(path):
    numba.njit(lambda x: x + 1)(2)
    pathlib.Path(path).write_text("there")

def sleep(path):
    write(path)
    time.sleep(60.0)
"""


def compile_one() -> None:
    numba.njit(lambda x: x + 1)(2)


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    (tmp_path / "jobs_of_a_test.py").write_text(MODULE)
    monkeypatch.syspath_prepend(str(tmp_path))  # type: ignore[no-untyped-call]
    monkeypatch.setattr(compile_ahead, "processors", lambda: 2)
    return "jobs_of_a_test"


def wait_for(condition: Callable[[], bool]) -> None:
    ends = time.monotonic() + 30.0
    while not condition():
        assert time.monotonic() < ends
        time.sleep(0.02)


def is_running(process: int) -> bool:
    """Whether a process is neither gone nor waiting to be collected."""
    status = Path(f"/proc/{process}/stat")
    try:
        return status.read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_the_second_process_runs_what_comes_later(module: str, tmp_path: Path) -> None:
    ran: list[str] = []
    compiled: list[int] = []
    later = tmp_path / "later"
    jobs = [
        Job("first", lambda: (compile_one(), ran.append("first")), f"{module}:write {tmp_path / 'first'}"),
        Job("second", lambda: ran.append("second"), f"{module}:write {later}"),
        Job("second", lambda: ran.append("failing"), f"{module}:unknown"),
    ]
    with CompileAhead(jobs, lambda: compiled.append(1)) as ahead:
        assert ahead._process is None
        ahead.prepare("first")
        assert ran == ["first"]
        wait_for(later.exists)
        ahead.prepare("second")
    assert sorted(ran) == ["failing", "first", "second"]  # this process has each in memory
    assert not (tmp_path / "first").exists()
    assert compiled


def test_without_anything_to_compile_there_is_no_second_process(module: str, tmp_path: Path) -> None:
    with CompileAhead([Job("all", lambda: None, f"{module}:write {tmp_path / 'file'}") for _ in range(2)]) as ahead:
        ahead.prepare("all")
        assert ahead._process is None


def test_one_processor_compiles_everything_itself(module: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compile_ahead, "processors", lambda: 1)
    ran: list[int] = []
    jobs = [Job("all", lambda: (compile_one(), ran.append(1)), f"{module}:write {tmp_path / 'file'}") for _ in range(2)]
    with CompileAhead(jobs) as ahead:
        ahead.prepare("all")
        assert ahead._process is None
    assert len(ran) == 2


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_the_second_process_stands_still_while_times_are_measured(module: str, tmp_path: Path) -> None:
    begun = tmp_path / "begun"
    jobs = [Job("first", compile_one), Job("second", compile_one, f"{module}:sleep {begun}")]
    with CompileAhead(jobs) as ahead:
        ahead.prepare("first")
        wait_for(begun.exists)
        assert ahead._process is not None
        state = Path(f"/proc/{ahead._process.pid}/stat")
        with ahead.paused():
            wait_for(lambda: state.read_text().rpartition(")")[2].split()[0] == "T")
        wait_for(lambda: state.read_text().rpartition(")")[2].split()[0] != "T")


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize("ending", ["error", "kill", "kill while paused"])
def test_nothing_is_left_behind(ending: str, module: str, tmp_path: Path) -> None:
    begun = tmp_path / "begun"
    program = f"""
import sys, time
sys.path.insert(0, {str(tmp_path)!r})
from pathlib import Path
import numba
from agents import compile_ahead
from agents.compile_ahead import CompileAhead, Job
compile_ahead.processors = lambda: 2
compile_one = lambda: numba.njit(lambda x: x + 1)(2)
with CompileAhead([Job("first", compile_one), Job("second", compile_one, "{module}:sleep {begun}")]) as ahead:
    ahead.prepare("first")
    while not Path({str(begun)!r}).exists():
        time.sleep(0.02)
    print(ahead._process.pid, flush=True)
    if {ending == "error"}:
        raise ValueError
    if {ending == "kill while paused"}:
        with ahead.paused():
            time.sleep(60.0)
    time.sleep(60.0)
"""
    with subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as process:
        assert process.stdout is not None
        second = int(process.stdout.readline())
        if ending != "error":
            time.sleep(0.3)
            os.kill(process.pid, signal.SIGKILL)
        process.wait()
    wait_for(lambda: not is_running(second))


def test_warmup_compiles_what_the_policies_of_an_environment_need(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ran: list[str] = []
    monkeypatch.setattr(benchmark, "evaluate", lambda policy, env_id, *rest, **more: ran.append(more["name"]))
    assert main(["warmup", "ExcavatorPayload-v0"]) == 0  # reading the agent may compile
    ran.clear()
    capsys.readouterr()
    assert main(["warmup", "ExcavatorPayload-v0"]) == 0
    assert ran == ["kalman", "agent", "adaptive", "integral_computed_torque", "computed_torque", "random"]
    assert capsys.readouterr().out.startswith("everything is compiled already, kept in ")
    monkeypatch.setattr(benchmark, "evaluate", lambda *rest, **more: compile_one())
    assert main(["warmup", "ExcavatorPayload-v0"]) == 0
    assert capsys.readouterr().out.startswith("compiled 6 functions, kept in ")
    monkeypatch.setattr(benchmark, "evaluate", lambda *rest, **more: signal.raise_signal(signal.SIGINT))
    assert main(["warmup", "ExcavatorPayload-v0"]) == 130
    assert capsys.readouterr().out.startswith("interrupted: ")


def test_a_job_of_the_benchmark_is_the_same_in_another_process(monkeypatch: pytest.MonkeyPatch) -> None:
    ran: list[tuple[object, ...]] = []

    def recording(policy: object, env_id: str, seeds: object, **settings: object) -> None:
        ran.append((settings["name"], env_id, list(seeds), settings["env_config"], settings["options"]))  # type: ignore[call-overload]

    monkeypatch.setattr(benchmark, "evaluate", recording)
    config = configure("benchmark", {}, ["ConveyorTrack-v0/paper", "ExcavatorPayload-v0"], full=False)
    jobs = [job for job in benchmark.Benchmark(config).jobs(lambda ended: None) if "_best_known" not in str(job.run)]
    for job in jobs:
        job.run()
    here = ran[:]
    ran.clear()
    for job in jobs:
        assert job.text is not None
        benchmark.run_job(job.text.partition(" ")[2])
    assert ran == here
