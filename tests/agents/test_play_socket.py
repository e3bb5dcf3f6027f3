"""The socket of `planarm play`: what a client that is no page of ours can send."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

OWN = """
class Fails:
    def __init__(self, error):
        self.error = error

    def predict(self, observation):
        raise self.error

boom, leaves = Fails(RuntimeError("boom")), Fails(SystemExit(3))

def picky(env):
    if env.spec.id != "MinTorqueMove-v0":
        raise TypeError("not made")
    return boom
"""


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A server that was given policies of the user's own; nothing unexpected is printed."""
    folder = tmp_path_factory.mktemp("own")
    (folder / "own_policies.py").write_text(OWN)
    own = [f"own_policies:{name}" for name in ("boom", "leaves", "picky")]
    command = [sys.executable, "-m", "planarm", "play", "MinTorqueMove-v0", "--no-browser", "--policies", *own]
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        yield server.stdout.readline().split()[2]
        server.send_signal(signal.SIGINT)
        _, said = server.communicate(timeout=20)
        assert server.returncode == 130
        assert "Traceback" not in said


@contextmanager
def page(address: str) -> Iterator[ClientConnection]:
    with connect(address.replace("http", "ws") + "play", origin=Origin(address.rstrip("/"))) as socket:
        answer(socket, "welcome")
        yield socket


def answer(socket: ClientConnection, *kinds: str) -> dict[str, Any]:
    """The next message of one of these kinds."""
    for _ in range(400):
        message: dict[str, Any] = json.loads(socket.recv(timeout=60))
        if message["kind"] in kinds:
            return message
    raise AssertionError(f"no {kinds}")


def asked(socket: ClientConnection, **message: Any) -> dict[str, Any]:
    """The answer to a message that has one."""
    socket.send(json.dumps(message))
    return answer(socket, "episode", "error")


def chosen(socket: ClientConnection, *policies: str, env: str = "MinTorqueMove-v0", **more: Any) -> dict[str, Any]:
    return asked(socket, do="choose", choice={"env": env, "policies": policies, **more})


def test_only_what_the_page_offers_can_be_chosen(address: str, tmp_path: Path) -> None:
    with page(address) as socket:
        for policy in ("builtins:exit", "os:getcwd", "own_policies:OWN", str(tmp_path), "model.zip"):
            assert "unknown policy of this page" in chosen(socket, policy)["text"]
        assert "unknown environment" in chosen(socket, "dpct", env="antigravity:ConveyorTrack-v0")["text"]
        assert "unknown arm" in chosen(socket, "dpct", arm=str(tmp_path / "arm.yaml"))["text"]
        assert chosen(socket, "own_policies:boom", "lagrange")["kind"] == "episode"


@pytest.mark.parametrize(
    ("policy", "said"), [("boom", "a policy failed: RuntimeError: boom"), ("leaves", "a policy failed: SystemExit: 3")]
)
def test_a_policy_that_fails_is_reported_and_the_page_lives_on(address: str, policy: str, said: str) -> None:
    with page(address) as socket:
        chosen(socket, f"own_policies:{policy}")
        assert answer(socket, "error")["text"] == said
        assert asked(socket, do="step")["text"] == said
        failed = chosen(socket, "own_policies:picky", env="ObstacleDodge-v0")
        assert failed["text"] == "a policy failed: TypeError: not made"
        assert chosen(socket, "lagrange")["kind"] == "episode"


def test_nonsense_is_answered_with_a_note(address: str) -> None:
    with page(address) as socket:
        socket.send(b"\x00\x01")
        assert answer(socket, "error")["text"] == "a message must be text"
        assert chosen(socket, "apf", env="ObstacleDodge-v0")["kind"] == "episode"
        assert "point" in asked(socket, do="change", key="disc", point=[1e308, 1e308])["text"]
        assert "must be from 0 to" in chosen(socket, "apf", env="ObstacleDodge-v0", payload=2.0)["text"]
        assert answer(socket, "frame")["policies"][0]["name"] == "apf"
