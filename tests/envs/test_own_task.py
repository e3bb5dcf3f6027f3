"""A task in a user's own file: what docs/extend/task.md says, done as its reader would, outside of planarm."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.pages import ROOT, follow

PAGE = (ROOT / "docs" / "extend" / "task.md").read_text()

USE = """
import sys

import gymnasium as gym
import numpy as np

if __name__ == "__main__":
    env = gym.make("circle_task:Circle-v0")
    import envs

    assert not [name for name in sys.modules if name.startswith("envs.conveyor_track")]
    observation, _ = env.reset(seed=0)
    assert env.action_space.contains(envs.make_expert("apf", env).predict(observation)[0])
    vector = gym.make_vec("Circle-v0", num_envs=3)
    np.testing.assert_array_equal(vector.reset(seed=0)[0][0], observation)
    workers = gym.vector.AsyncVectorEnv([lambda: gym.make("circle_task:Circle-v0")], context="spawn")
    np.testing.assert_array_equal(workers.reset(seed=0)[0][0], observation)
    workers.close()
    for refused, reason in [({"arm": "PLANAR_3R"}, "2 links"), ({"rat": 1.0}, 'did you mean "rate"')]:
        try:
            gym.make("Circle-v0", **refused)
        except ValueError as error:
            assert reason in str(error), error
        else:
            raise AssertionError(refused)
"""


def run(folder: Path, *command: str) -> str:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(folder)])}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def write_files(folder: Path) -> None:
    """The page's files alone."""
    for name, code in re.findall(r"^```\w+\n# ([\w.]+)\n(.*?)^```", PAGE, flags=re.DOTALL | re.MULTILINE):
        (folder / name).write_text(code)


@pytest.mark.docs
def test_the_page_works_from_a_folder_of_ones_own(tmp_path: Path) -> None:
    printed = follow("extend/task.md", tmp_path)
    assert "Circle-v0: seeds 0, 1, 2, 3, " in (tmp_path / "circle.html").read_text(encoding="utf-8")  # replays
    first, apf, loaded, *_ = printed.splitlines()
    assert re.fullmatch(r"True [-+.e\d]+ [-+.e\d]+ \(640, 960, 3\)", first)
    assert float(apf) == float(loaded) == 1.0
    assert (tmp_path / "last.png").stat().st_size > 0


def test_a_complete_task_takes_at_most_150_lines() -> None:
    code = re.findall(r"^```python\n# circle_task\.py\n(.*?)^```", PAGE, flags=re.DOTALL | re.MULTILINE)[0]
    assert len(code.splitlines()) <= 150


def test_it_is_single_vector_and_in_workers_the_same(tmp_path: Path) -> None:
    write_files(tmp_path)
    (tmp_path / "use.py").write_text(USE)
    run(tmp_path, sys.executable, "use.py")


@pytest.mark.rl
def test_an_agent_is_trained_by_the_pages_recipe(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3", reason='needs pip install "planarm[rl]"')
    write_files(tmp_path)
    small = ["total_steps=800", "num_envs=4", "rollout_steps=50", "batch_size=100", "evaluation_episodes=2"]
    run(tmp_path, sys.executable, "-m", "agents.cli", "train", "circle.yaml", *small, "--out", "run")
    assert ",apf," in (tmp_path / "run" / "metrics.csv").read_text()
    code = "import agents, circle_task; print(agents.evaluate('run', 'Circle-v0', range(2)).lengths.tolist())"
    assert run(tmp_path, sys.executable, "-c", code).strip() == "[150, 150]"
