"""Zips of Stable-Baselines3: opened only if allowed, with their statistics, in the environment that they fit."""

from __future__ import annotations

import shutil
import zipfile
from importlib import import_module
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import agents
import envs
from agents.cli import main
from agents.policies.sb3 import load_model

ENV = "ConveyorTrack-v0"
FEW = ["--episodes", "2"]
SMALL: dict[str, Any] = {"policy_kwargs": {"net_arch": [8]}, "seed": 1, "device": "cpu", "n_steps": 64}

pytestmark = pytest.mark.rl


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a model of jerks, one behind a VecNormalize with its statistics and one without, one of a dodge."""
    assert {ENV, "ObstacleDodge-v0"} <= set(envs.env_ids())
    folder = tmp_path_factory.mktemp("models")
    library: Any = import_module("stable_baselines3")
    vectors: Any = import_module("stable_baselines3.common.vec_env")
    import_module("torch").set_num_threads(1)
    library.PPO("MlpPolicy", gym.make(ENV, control_mode="jerk"), **SMALL).save(folder / "jerk.zip")
    library.PPO("MlpPolicy", gym.make("ObstacleDodge-v0"), **SMALL).save(folder / "dodge.zip")
    normalized = vectors.VecNormalize(vectors.DummyVecEnv([lambda: gym.make(ENV)]))
    model = library.PPO("MlpPolicy", normalized, **SMALL).learn(64)
    model.save(folder / "bare.zip")
    (folder / "with").mkdir()
    model.save(folder / "with" / "normal.zip")
    normalized.save(folder / "with" / "vecnormalize.pkl")
    return folder


def test_statistics_beside_a_model_are_used(models: Path) -> None:
    library: Any = import_module("stable_baselines3")
    vectors: Any = import_module("stable_baselines3.common.vec_env")
    model = library.PPO.load(models / "with" / "normal.zip", device="cpu")
    venv = vectors.DummyVecEnv([lambda: gym.make(ENV)])
    statistics = vectors.VecNormalize.load(models / "with" / "vecnormalize.pkl", venv)

    class ByHand:
        def predict(self, observation: Any, **more: Any) -> Any:
            return model.predict(statistics.normalize_obs(observation), deterministic=True)

    own = agents.evaluate(
        str(models / "with" / "normal.zip"), ENV, range(3), allow_code=True, env_config={"control_mode": "torque"}
    )
    assert own.policy == "normal"
    np.testing.assert_array_equal(own.returns, agents.evaluate(ByHand(), ENV, range(3)).returns)


def test_statistics_in_a_folder_of_the_models_name_are_used_as_the_zoo_writes_them(
    models: Path, tmp_path: Path
) -> None:
    (tmp_path / "zoo").mkdir()
    shutil.copy(models / "with" / "normal.zip", tmp_path / "zoo.zip")
    shutil.copy(models / "with" / "vecnormalize.pkl", tmp_path / "zoo" / "vecnormalize.pkl")
    given: dict[str, Any] = {"allow_code": True, "env_config": {}}
    zoo, beside = (
        agents.evaluate(str(path), ENV, range(2), **given)
        for path in (tmp_path / "zoo.zip", models / "with" / "normal.zip")
    )
    np.testing.assert_array_equal(zoo.returns, beside.returns)


def test_a_damaged_model_is_named(models: Path, tmp_path: Path) -> None:
    content = (models / "jerk.zip").read_bytes()
    with zipfile.ZipFile(models / "jerk.zip") as whole, zipfile.ZipFile(tmp_path / "jerk.zip", "w") as part:
        part.writestr("data", whole.read("data"))
    with pytest.raises(ValueError, match=r"jerk\.zip is damaged"):
        agents.evaluate(str(tmp_path / "jerk.zip"), ENV, [0], allow_code=True, env_config={})
    (tmp_path / "jerk.zip").write_bytes(content[: len(content) // 2])
    with pytest.raises(ValueError, match=r"jerk\.zip is no model"):
        agents.evaluate(str(tmp_path / "jerk.zip"), ENV, [0], allow_code=True, env_config={})
    for data in ("5", "null", "NaN", "[1, 2]", "[" * 100_000, "\xff"):
        with zipfile.ZipFile(tmp_path / "jerk.zip", "w") as wrong:
            wrong.writestr("data", data.encode("latin-1"))
        with pytest.raises(ValueError, match=r"jerk\.zip is no model"):
            agents.evaluate(str(tmp_path / "jerk.zip"), ENV, [0], allow_code=True, env_config={})


@pytest.mark.parametrize(
    ("name", "complaint"),
    [
        ("bare.zip", r"trained behind a VecNormalize, .* not beside it: .*get_vec_normalize_env\(\)\.save"),
        (
            "dodge.zip",
            r"trained with an observation space of shape \(36,\), and that of ConveyorTrack-v0 is of shape \(18,\)",
        ),
        ("none.zip", "no file .*none.zip"),
    ],
)
def test_what_does_not_fit_is_refused(models: Path, name: str, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        agents.evaluate(str(models / name), ENV, [0], allow_code=True, env_config={})


def test_other_files_than_statistics_are_refused(models: Path, tmp_path: Path) -> None:
    (tmp_path / "jerk.zip").write_bytes((models / "jerk.zip").read_bytes())
    (tmp_path / "jerk_vecnormalize.pkl").write_text("no pickle")
    with pytest.raises(ValueError, match="holds no statistics of a VecNormalize"):
        agents.evaluate(str(tmp_path / "jerk.zip"), ENV, [0], allow_code=True)


@pytest.mark.parametrize(
    "arguments",
    [
        ["benchmark", "--tasks", ENV, "--bound-episodes", "0", *FEW, "--policies", "dpct"],
        ["evaluate", "dpct", "--env", ENV, *FEW, "--against"],
        ["rollout", ENV, "--policy"],
        ["paths", ENV, "--policies"],
    ],
    ids=lambda arguments: arguments[0],
)
def test_every_command_opens_it_if_allowed_and_says_what_it_assumes(
    models: Path, arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    command = [*arguments, str(models / "jerk.zip")]
    assert main(command) == 2
    assert "pass --allow-code" in capsys.readouterr().err
    assert main([*command, "--allow-code"]) == 0
    captured = capsys.readouterr()
    assert "jerk" in captured.out
    assert "jerk does not say in which control mode it was trained" in captured.err
    assert main([*command, "--allow-code", "--settings", "control_mode=jerk"]) == 0
    assert "does not say" not in capsys.readouterr().err


def test_python_warns_of_what_is_assumed(models: Path) -> None:
    with pytest.warns(UserWarning, match="taken for control_mode torque"):
        agents.evaluate(str(models / "jerk.zip"), ENV, [0], allow_code=True)


def test_a_model_in_memory_is_scored_in_the_settings_of_its_environment() -> None:
    library: Any = import_module("stable_baselines3")
    model = library.PPO("MlpPolicy", gym.make(ENV, control_mode="jerk", horizon=2.0), **SMALL)
    own = agents.evaluate(model, ENV, range(2))
    assert own.lengths.tolist() == [100, 100]
    given = agents.evaluate(model, ENV, range(2), env_config={"control_mode": "jerk", "horizon": 2.0})
    assert own.returns.tolist() == given.returns.tolist()


@pytest.mark.parametrize("made", [False, True])
def test_a_model_in_memory_acts_behind_the_statistics_of_its_environment(made: bool) -> None:
    library: Any = import_module("stable_baselines3")
    vectors: Any = import_module("stable_baselines3.common.vec_env")
    normalized = vectors.VecNormalize(vectors.DummyVecEnv([lambda: gym.make(ENV)]))
    model = library.PPO("MlpPolicy", normalized, **SMALL).learn(64)
    own = agents.evaluate((lambda: model) if made else model, ENV, range(2))
    exported = agents.evaluate(agents.export_agent(model, ENV), ENV, range(2))
    np.testing.assert_allclose(own.returns, exported.returns, rtol=1e-4)


@pytest.mark.parametrize("algorithm", ["SAC", "TD3", "DDPG"])
@pytest.mark.parametrize("steps", [30, 150])  # in the middle of an episode, and at its end
def test_missing_statistics_of_models_with_a_replay_buffer_are_named(
    algorithm: str, steps: int, tmp_path: Path
) -> None:
    library: Any = import_module("stable_baselines3")
    vectors: Any = import_module("stable_baselines3.common.vec_env")
    more = {"learning_starts": 1000, "buffer_size": 100, "device": "cpu"}
    plain = vectors.DummyVecEnv([lambda: gym.make(ENV)])
    getattr(library, algorithm)("MlpPolicy", plain, **more).learn(steps).save(tmp_path / "plain.zip")
    model = getattr(library, algorithm)("MlpPolicy", vectors.VecNormalize(plain), **more).learn(steps)
    model.save(tmp_path / "bare.zip")
    assert load_model(tmp_path / "plain.zip", ENV, allow_code=True).predict(plain.reset())[0].shape[0] == 1
    with pytest.raises(ValueError, match=r"trained behind a VecNormalize, .* not beside it"):
        load_model(tmp_path / "bare.zip", ENV, allow_code=True)


def test_statistics_beside_several_models_belong_to_the_one_they_are_named_after(models: Path, tmp_path: Path) -> None:
    for name in ("jerk.zip", "with/normal.zip", "with/vecnormalize.pkl"):
        shutil.copy(models / name, tmp_path)
    for name in ("jerk.zip", "normal.zip"):
        with pytest.raises(ValueError, match="does not say whose statistics it holds"):
            load_model(tmp_path / name, ENV, allow_code=True)
    (tmp_path / "vecnormalize.pkl").rename(tmp_path / "normal_vecnormalize.pkl")
    assert type(load_model(tmp_path / "normal.zip", ENV, allow_code=True)).__name__ == "NormalizedPolicy"
    assert type(load_model(tmp_path / "jerk.zip", ENV, allow_code=True)).__name__ == "PPO"
