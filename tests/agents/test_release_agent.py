"""`python -m tools.release_agent`: which agent is chosen, what its JSON says, and what is refused."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from run_folders import CONVEYOR, config, make_run

import envs
from agents.evaluation.evaluate import evaluate
from agents.evaluation.statistics import Estimate
from agents.policies.agent import FORMAT, Agent
from agents.policies.files import describe_layout, layout_of, load_agent, save_agent
from agents.training.learning_curves import read_curve
from tools.release_agent import TRAINED, Candidate, ReleaseOptions, choose, main, score
from tools.site.training_seeds import spread, training_seeds

SETTINGS = {"control_mode": "jerk", "limit_penalty": 0.5}
"""Of the training: the meaning of actions, and a reward that is not the environment's own."""
ROWS = [(0, 5.0, 0.0, -1.0, float("inf")), (100, 9.0, 0.5, 1.0, 2.0), (200, 13.0, 0.4, 1.1, 2.0)]
EPISODES = 6


def agent(seed: int, hidden: int = 4) -> Agent:
    """An agent with weights at random."""
    layout, generator = layout_of(CONVEYOR, SETTINGS), np.random.default_rng(seed)
    outputs = gym.make(CONVEYOR).action_space.shape[0]  # type: ignore[index]
    shapes = {"layer0.weight": (hidden, layout.size), "layer0.bias": (hidden,)}
    shapes |= {"layer1.weight": (outputs, hidden), "layer1.bias": (outputs,), "log_std": (outputs,)}
    tensors: dict[str, Any] = {
        name: generator.standard_normal(shape, dtype=np.float32) for name, shape in shapes.items()
    }
    tensors |= {"fine.index": np.zeros(0, dtype=np.int64), "fine.gain": np.zeros(0, dtype=np.float32)}
    document = {"format": FORMAT, "env": CONVEYOR, "env_config": SETTINGS, **describe_layout(layout)}
    document |= {"activation": "tanh", "hidden": [hidden], "scores": {"success": 0.5, "return": 1.0}}
    document["training"] = {"config": config(seed=seed, env_config=SETTINGS).model_dump(mode="json"), "seed": seed}
    return Agent(document, tensors)


def run_of(folder: Path, seed: int, hidden: int = 4) -> Path:
    make_run(folder, ROWS, seed=seed, env_config=SETTINGS)
    save_agent(agent(seed, hidden), folder / "best.safetensors")
    return folder


@pytest.fixture
def runs(tmp_path: Path) -> tuple[Path, ...]:
    return tuple(run_of(tmp_path / f"run-{seed}", seed) for seed in (2, 0, 1))


def scored(selection: tuple[float, float], held_out: tuple[float, float], candidate: Candidate) -> Candidate:
    """A candidate with success and return on both sets."""
    scores = [
        {"success": Estimate(success, 0.0, 1.0), "return": Estimate(mean, np.nan, np.nan)}
        for success, mean in (selection, held_out)
    ]
    return replace(candidate, selection=scores[0], held_out=scores[1])


@pytest.mark.parametrize(
    ("selections", "chosen"),
    [
        ([(0.9, 2.0), (0.95, 1.0), (0.8, 3.0)], 1),
        ([(0.9, 1.0), (0.9, 1.1), (0.9, 0.9)], 1),
        ([(0.9, 1.0), (0.9, 1.0), (0.8, 9.0)], 0),
    ],
)
@pytest.mark.parametrize("best_held_out", range(3))
def test_success_then_return_choose_and_held_out_scores_do_not(
    selections: list[tuple[float, float]], chosen: int, best_held_out: int, tmp_path: Path
) -> None:
    curve = read_curve(make_run(tmp_path / "run", ROWS))
    blank = Candidate(curve, agent(0), curve.config, {}, {})
    candidates = [
        scored(selection, (1.0, 9.0) if number == best_held_out else (0.1, 0.0), blank)
        for number, selection in enumerate(selections)
    ]
    assert choose(candidates) is candidates[chosen]


def test_the_released_agent_and_all_that_its_json_says(
    runs: tuple[Path, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(ReleaseOptions(runs, out=tmp_path / "out", episodes=EPISODES)) == 0
    shipped = load_agent(tmp_path / "out" / f"{CONVEYOR}.safetensors")

    def returns(seed: int, first: int) -> float:
        settings = {"control_mode": "jerk"}
        return float(
            evaluate(agent(seed), CONVEYOR, range(first, first + EPISODES), env_config=settings).returns.mean()
        )

    chosen = max(range(3), key=lambda seed: returns(seed, 2_000_000))  # none of them ever succeeds
    document = shipped.document
    assert document["training"]["seed"] == chosen
    for name, tensor in agent(chosen).tensors.items():
        np.testing.assert_array_equal(shipped.tensors[name], tensor)
    assert document["scores"] == agent(chosen).document["scores"]
    assert document["env_config"] == SETTINGS
    assert document["selection"]["seeds"] == [2_000_000, 2_000_000 + EPISODES - 1]
    assert document["selection"]["return"] == returns(chosen, 2_000_000)
    assert document["held_out"]["seeds"] == [0, EPISODES - 1]
    assert document["held_out"]["return"] == returns(chosen, 0)
    assert document["held_out"]["env_config"] == {"control_mode": "jerk"}
    assert document["held_out"]["settling_time"] is None  # never
    z = 1.959963984540054  # Wilson's interval of no success
    assert document["held_out"]["success"] == pytest.approx(
        {"value": 0.0, "low": 0.0, "high": z**2 / (EPISODES + z**2)}
    )
    assert "highest success, then the highest mean return" in document["selection"]["rule"]
    assert [(row["seed"], row["steps"], row["best_steps"], row["seconds"]) for row in document["seeds"]] == [
        (seed, 200, 100, 13.0) for seed in range(3)
    ]
    assert [row["held_out"]["return"] for row in document["seeds"]] == [returns(seed, 0) for seed in range(3)]
    over_seeds = [returns(seed, 0) for seed in range(3)]
    assert document["over_seeds"]["return"] == pytest.approx(
        {
            "mean": np.mean(over_seeds),
            "std": np.std(over_seeds, ddof=1),
            "min": min(over_seeds),
            "max": max(over_seeds),
        }
    )
    printed = [line for line in capsys.readouterr().out.splitlines() if line.startswith("|")]
    assert printed == [line for line in str(training_seeds(document)).splitlines() if line]  # as from the file
    rows = [line.split("|")[1].strip() for line in printed if not line.startswith("|-")]
    names = [f"**{seed}**, shipped" if seed == chosen else str(seed) for seed in range(3)]
    assert rows == ["training seed", *names, "mean ± std", "least", "greatest"]


def test_one_seed_has_no_deviation() -> None:
    assert np.isnan(spread([1.5])["std"])
    assert spread([1.0, 4.0]) == pytest.approx({"mean": 2.5, "std": 1.5 * 2**0.5, "min": 1.0, "max": 4.0})
    assert spread([1.0, np.inf])["mean"] == np.inf
    assert np.isnan(spread([1.0, np.inf])["std"])


@pytest.mark.parametrize(
    ("names", "complaint"),
    [
        ([], "no runs"),
        (["none"], "cannot read"),
        (["run-0", "unfinished"], "not finished .100 of 200 steps."),
        (["run-0", "other"], "differ in gamma"),
        (["run-0", "again"], "the same run twice"),
        (["run-0", "move"], "give runs of one environment"),
        (["run-0", "large"], "bytes, more than the 300000"),
        (["run-0", "no-agent"], "no-agent has no best.safetensors"),
    ],
)
def test_what_cannot_be_released_is_refused(
    names: list[str], complaint: str, runs: tuple[Path, ...], tmp_path: Path
) -> None:
    make_run(tmp_path / "unfinished", ROWS[:2], seed=7, env_config=SETTINGS)
    make_run(tmp_path / "other", ROWS, seed=7, env_config=SETTINGS, gamma=0.9)
    make_run(tmp_path / "move", ROWS, env="MinTorqueMove-v0")
    make_run(tmp_path / "no-agent", ROWS, seed=8, env_config=SETTINGS)
    run_of(tmp_path / "again", 0)
    run_of(tmp_path / "large", 9, hidden=5000)
    out = tmp_path / "out"
    with pytest.raises(ValueError, match=complaint):
        main(ReleaseOptions(tuple(tmp_path / name for name in names), out=out, episodes=EPISODES))
    assert not out.exists()


def test_no_episodes_are_refused(runs: tuple[Path, ...], tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="episodes 0"):
        main(ReleaseOptions(runs, out=tmp_path / "out", episodes=0))


def test_the_command_says_what_is_wrong_in_a_line(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "tools.release_agent", str(tmp_path / "none")]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 1
    assert result.stderr.startswith("release: cannot read")
    assert result.stderr.count("\n") == 1


def test_by_default_agents_are_released_where_they_are_looked_for() -> None:
    assert (TRAINED / f"{CONVEYOR}.safetensors").exists()


def test_an_agent_for_harder_episodes_is_scored_in_its_own_settings(runs: tuple[Path, ...], tmp_path: Path) -> None:
    assert main(ReleaseOptions(runs, out=tmp_path / "out", episodes=2, variant="harder")) == 0
    assert [path.name for path in sorted((tmp_path / "out").iterdir())] == [
        f"{CONVEYOR}.harder.json",
        f"{CONVEYOR}.harder.safetensors",
    ]
    document = json.loads((tmp_path / "out" / f"{CONVEYOR}.harder.json").read_text())
    assert document["held_out"]["env_config"] == document["selection"]["env_config"] == SETTINGS
    assert "levels" not in document["held_out"]


def test_episodes_are_divided_among_the_levels_of_the_recipe(tmp_path: Path) -> None:
    config = read_curve(make_run(tmp_path / "run", ROWS)).config
    at_levels = config.model_copy(update={"levels": ("default", "fast"), "evaluation_episodes": 4})
    each = [
        evaluate(agent(0), CONVEYOR, [first, first + 2], env_config=config.env_config, options=options)
        for first, options in ((5, {}), (6, dict(envs.task_card(CONVEYOR).levels["fast"].options)))
    ]
    expected = np.concatenate([part.returns for part in each]).mean()
    assert score(agent(0), at_levels, 5)["return"].value == pytest.approx(expected, abs=1e-12)


@pytest.mark.rl
def test_real_runs_are_released_and_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from agents import cli

    small = ["total_steps=400", "num_envs=4", "rollout_steps=50", "batch_size=100", "hidden=[8]", "warm_start=null"]
    small += ["checkpoint_steps=200", "evaluation_episodes=2", "baselines=[apf]"]
    folders = [tmp_path / f"run-{seed}" for seed in range(2)]
    for seed, folder in enumerate(folders):
        arguments = ["train", f"ppo/{CONVEYOR}", *small, "--seed", str(seed), "--out", str(folder)]
        assert cli.main(arguments) == 0
    assert cli.main(["curves", *map(str, folders)]) == 0
    assert "|PPO alone   |    2|" in capsys.readouterr().out
    assert main(ReleaseOptions(tuple(folders), out=tmp_path / "out", episodes=2)) == 0
    document = json.loads((tmp_path / "out" / f"{CONVEYOR}.json").read_text())
    assert [row["seed"] for row in document["seeds"]] == [0, 1]
