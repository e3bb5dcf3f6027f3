"""The connection to Ray: wrong addresses are refused at once, and signals stay those of the command."""

from __future__ import annotations

import os
import signal
import socket
from pathlib import Path

import pytest
from test_cluster import RECIPE

from agents.cli import main

BENCHMARK = ["benchmark", "--tasks", "MinTorqueMove-v0", "--policies", "random", "--episodes", "2"]


def closed_port() -> int:
    """A port at which nothing listens."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        port: int = one.getsockname()[1]
        return port


@pytest.mark.parametrize(
    ("address", "complaint"),
    [("127.0.0.1:{port}", "refused"), ("head", "local, auto or host:port"), (":1", "local, auto or host:port")],
)
def test_an_address_without_a_cluster_is_refused_at_once(
    address: str, complaint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("ray")
    assert main([*BENCHMARK, "--address", address.format(port=closed_port())]) == 2
    error = capsys.readouterr().err
    assert "no Ray cluster at address" in error
    assert complaint in error


def test_the_address_of_the_environment_is_tried_too(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("ray")
    monkeypatch.setenv("RAY_ADDRESS", f"127.0.0.1:{closed_port()}")
    assert main([*BENCHMARK, "--address", "auto"]) == 2
    assert "refused" in capsys.readouterr().err


@pytest.mark.rl
def test_a_sweep_that_cannot_begin_leaves_no_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("ray")
    (tmp_path / "tiny.yaml").write_text(RECIPE)
    sweep = ["sweep", str(tmp_path / "tiny.yaml"), "--over", "seed=0..1", "--out", str(tmp_path / "sweep")]
    for wrong in (["--address", f"127.0.0.1:{closed_port()}"], ["--processors", "0"]):
        assert main([*sweep, *wrong]) == 2
        assert not (tmp_path / "sweep").exists()
    (tmp_path / "sweep").mkdir()
    (tmp_path / "sweep" / "mine").touch()
    assert main(sweep) == 2
    assert "is not empty: choose another --out" in capsys.readouterr().err


@pytest.mark.cluster
def test_sigterm_stays_that_of_the_command() -> None:
    from agents.cluster import connected
    from agents.console import catch_interrupt, exit_code_of

    with pytest.raises(KeyboardInterrupt) as end, catch_interrupt(at_once=True), connected("local", 1):
        os.kill(os.getpid(), signal.SIGTERM)
    assert exit_code_of(end.value) == 143
