"""Kills and interrupts `planarm` at random moments: are runs whole, how soon do commands end; needs the `rl` extra.

    python -m tools.kill_training                   # 50 kill -9 of training, half of them while a file is written
    python -m tools.kill_training --signal INT      # Ctrl-C, or TERM: how long until the run, and each command, ends

A run that is killed must go on from its last checkpoint or a later one, and end bit for bit like one that was not.
"""

from __future__ import annotations

import csv
import json
import multiprocessing
import os
import signal
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import numpy as np
import tyro

from agents.cli import main as planarm
from agents.policies.files import load_agent
from agents.training.recipe import TrainingConfig

_COMMON: dict[str, Any] = {
    "env": "ConveyorTrack-v0",
    "env_config": {"control_mode": "jerk", "horizon": 2.0},
    "num_envs": 4,
    "rollout_steps": 50,
    "hidden": [8, 8],
    "evaluation_episodes": 3,
    "baselines": ["apf", "lagrange"],
}
_REPLAY: dict[str, Any] = {
    **_COMMON,
    "rollout_steps": 2,
    "total_steps": 2000,
    "checkpoint_steps": 200,
    "learning_starts": 100,
    "batch_size": 64,
    "buffer_size": 1000,
    "demonstrations": {"expert": "apf", "episodes": 4},
}
RECIPES: dict[str, dict[str, Any]] = {
    "ppo": {
        **_COMMON,
        "total_steps": 3200,
        "checkpoint_steps": 200,
        "batch_size": 100,
        "epochs": 2,
        "warm_start": {"expert": "apf", "episodes": 8, "rounds": 3, "updates": 200, "batch_size": 64},
    },
    "sac": {**_REPLAY, "algorithm": "sac"},
    "td3": {**_REPLAY, "algorithm": "td3"},
    "amortise": {
        "env": "MinTorqueMove-v0",
        "env_config": {"control_mode": "motion"},
        "whole_episodes": True,
        "amortise": {"moves": 1024, "updates": 2000, "batch_size": 64},
        "num_envs": 8,
        "rollout_steps": 4,
        "batch_size": 16,
        "total_steps": 320,
        "checkpoint_steps": 32,
        "hidden": [8, 8],
        "evaluation_episodes": 2,
        "baselines": [],
    },
}
COMMANDS = (
    "evaluate lagrange --env MinTorqueMove-v0 --episodes 64",
    "evaluate dpct --env ObstacleDodge-v0 --episodes 64",
    "evaluate adaptive --env ExcavatorPayload-v0 --episodes 64",
    "benchmark --episodes 32 --bound-episodes 4",
    "paths ObstacleDodge-v0 --plot {folder}/paths.png",
    "rollout ConveyorTrack-v0 --policy dpct --record {folder}/film.gif",
    "plan --arm SCARA_1M --start 0.3 1.2 --to 0.3 0.9",
    "list",
    "play --no-browser",
    "dataset MinTorqueMove-v0 --policies lagrange --episodes 64 --overwrite --out lagrange-v0",
    "sweep ppo/ConveyorTrack-v0 --over seed=0,1 --out {folder}/sweep",
    "submit check submissions/planarm-conveyor-track",
    "paper-dpct --json {folder}/dpct.json",
    "paper-lagrange --json {folder}/lagrange.json",
    "paper-apf --json {folder}/apf.json",
    "paper-excavator --json {folder}/excavator.json",
)


@dataclass
class Ended:
    """How a process ended: its exit code, what it said last, and the seconds since it was sent a signal."""

    code: int | None
    said: str
    seconds: float


class Child:
    """A command of planarm in a process of its own, which need not import everything again."""

    _processes: Any = None

    def __init__(self, arguments: Sequence[str], log: Path) -> None:
        if Child._processes is None:
            Child._processes = multiprocessing.get_context("forkserver")
            modules = [
                "agents.training.run",
                "agents.commands.train",
                "agents.commands.benchmark",
                "agents.papers.dpct.command",
            ]
            Child._processes.set_forkserver_preload(modules)
        self.log = log
        self.process = Child._processes.Process(target=_run, args=(list(arguments), str(log)))
        self.process.start()

    def end(self, number: signal.Signals) -> Ended:
        """Send a signal and wait."""
        before = time.perf_counter()
        if self.process.is_alive():
            os.kill(self.process.pid, number)
        self.process.join()
        seconds = time.perf_counter() - before
        lines = self.log.read_text(errors="replace").split("\n") if self.log.exists() else []
        return Ended(self.process.exitcode, "\n".join(line for line in lines if line)[-2000:], seconds)


def _run(arguments: list[str], log: str) -> None:
    with open(log, "w", buffering=1) as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        code = planarm(arguments)
    sys.exit(code)


def steps_done(folder: Path) -> int:
    """Control steps at the last checkpoint whose row was written; -1 before the first."""
    path = folder / "metrics.csv"
    if not path.exists() or not (folder / "checkpoint.pt").exists():
        return -1
    with path.open() as file:
        return max(int(row["steps"]) for row in csv.DictReader(file))


def outcome(folder: Path) -> dict[str, Any]:
    """All that a finished run leaves, but for the time it took."""
    found: dict[str, Any] = {}
    for agent in ("last", "best"):
        document = json.loads((folder / f"{agent}.json").read_text())
        del document["training"]["seconds"]
        found[agent] = document, (folder / f"{agent}.safetensors").read_bytes()
    with (folder / "metrics.csv").open() as file:
        found["metrics"] = [{name: row[name] for name in row if name != "seconds"} for row in csv.DictReader(file)]
    return found


def begin(name: str, folder: Path) -> None:
    """A run of one of `RECIPES` in a new folder."""
    from agents.training.run import TrainingRun

    TrainingRun.begin(folder, TrainingConfig.parse(RECIPES[name], "training setting"), "tools.kill_training")


def kill_run(name: str, kills: int, number: signal.Signals, folder: Path, generator: Any) -> list[tuple[str, Ended]]:
    """Kill a run again and again and let it end; what it was killed in, and how it ended each time.

    Raises:
        AssertionError: if it loses a checkpoint, leaves an agent that cannot be loaded, or ends otherwise than a run
            that was left alone.
    """
    whole, run, ended = folder / f"{name}-whole", folder / f"{name}-killed", []
    begin(name, whole)
    before = time.perf_counter()
    child = Child(["train", "--resume", str(whole)], folder / "log")
    child.process.join()
    assert child.process.exitcode == 0, (folder / "log").read_text()
    span = time.perf_counter() - before
    begin(name, run)
    for kill in range(kills):
        done, writing = steps_done(run), kill % 2 == 0 and number == signal.SIGKILL
        delay, drafts = generator.uniform(0.0, span / 3.0), 0
        wanted = int(generator.integers(1, 12))
        child = Child(["train", "--resume", str(run)], folder / "log")
        until, last = time.perf_counter() + (2.0 * span if writing else delay), ""
        while child.process.is_alive() and time.perf_counter() < until:
            draft = next((path.name for path in run.glob(".*.*.*")), "") if writing else ""
            drafts, last = drafts + (draft not in ("", last)), draft or last
            if writing and drafts >= wanted:
                break
            if not writing and steps_done(run) > done + 600:  # none may come so late that nothing is left to kill
                break
            time.sleep(0.0 if writing else 0.002)
        late = not child.process.is_alive()
        result = child.end(number)
        now = steps_done(run)
        assert now >= done, f"{name}: from {done} back to {now} steps"
        if (run / "best.safetensors").exists():
            load_agent(run)
        ended.append(("after its end" if late else f"writing {last}" if writing else f"at {now} steps", result))
        assert late or number == signal.SIGKILL or result.code in (0, 128 + number), (
            f"exit code {result.code}: {result.said}"
        )
        if late:
            break
    child = Child(["train", "--resume", str(run)], folder / "log")
    child.process.join()
    assert child.process.exitcode == 0, (folder / "log").read_text()
    assert outcome(run) == outcome(whole), f"{name}: another end than without kills"
    assert not list(run.glob(".*.*.*")), f"{name}: drafts are left"
    return ended


def interrupt_command(line: str, number: signal.Signals, folder: Path, generator: Any) -> tuple[str, Ended]:
    """Interrupt a command at a random moment of its first seconds."""
    place = folder / "command"
    place.mkdir(exist_ok=True)
    child = Child(line.format(folder=place).split(), folder / "log")
    until = time.perf_counter() + generator.uniform(0.0, 12.0)
    while child.process.is_alive() and time.perf_counter() < until:
        time.sleep(0.002)
    late = not child.process.is_alive()
    result = child.end(number)
    drafts = [path.name for path in place.iterdir() if path.name.startswith(".")]
    assert not drafts, f"{line} leaves {drafts}"
    assert "Traceback" not in result.said, result.said
    return ("after its end" if late else line.split(" --")[0]), result


@dataclass(frozen=True)
class KillOptions:
    """Kill or interrupt training, and other commands, at random moments."""

    signal: Literal["KILL", "INT", "TERM"] = "KILL"
    """KILL cannot be caught; INT is Ctrl-C."""
    kills: int = 50
    """Of training, over all recipes."""
    commands: int = 0
    """Interrupts of each other command."""
    recipes: tuple[Literal["ppo", "sac", "td3", "amortise"], ...] = ("ppo", "sac", "td3", "amortise")
    """What is trained."""
    seed: int = 0
    """Of the moments."""


def main(options: KillOptions) -> int:
    """Run the campaign; the exit code."""
    number, generator = signal.Signals[f"SIG{options.signal}"], np.random.default_rng(options.seed)
    ended: list[tuple[str, Ended]] = []
    with TemporaryDirectory() as name:
        folder = Path(name)
        os.environ["MINARI_DATASETS_PATH"] = name
        for place, recipe in enumerate(options.recipes):
            share = options.kills // len(options.recipes) + (place < options.kills % len(options.recipes))
            if share:
                ended += [
                    (f"train {recipe}, {what}", how) for what, how in kill_run(recipe, share, number, folder, generator)
                ]
        for line in COMMANDS:
            ended += [interrupt_command(line, number, folder, generator) for _ in range(options.commands)]
    met = [(what, how) for what, how in ended if not what.endswith("after its end")]
    for what, how in sorted(met, key=lambda pair: -pair[1].seconds):
        print(f"{how.seconds:7.3f} s  exit {how.code}  {what}")
    slowest = max((how.seconds for _, how in met), default=0.0)
    print(f"{len(met)} of {len(ended)} met a running process; the slowest answer took {slowest:.2f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main(tyro.cli(KillOptions)))
