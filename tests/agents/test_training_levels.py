"""Training at difficulty levels, also those of reset options and several at once, and with forecasts for actions."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason='needs pip install "planarm[rl]"')

from agents import evaluate, load_agent
from agents.commands.train import TrainOptions
from agents.environments import make_batch
from agents.training.batches import training_batch
from agents.training.batches.estimates import OnEstimates, certain_conditions, check_estimates
from agents.training.batches.levels import SideBySide
from agents.training.recipe import TrainingConfig
from agents.training.run import TrainingRun
from agents.training.vec_env import NativeVecEnv
from envs.conveyor_track.filtered import FilteredPolicy

pytestmark = pytest.mark.rl

SMALL: dict[str, Any] = {
    "env": "ObstacleDodge-v0",
    "env_config": {"control_mode": "velocity", "horizon": 0.6, "physics": "closed_form"},
    "total_steps": 400,
    "num_envs": 4,
    "rollout_steps": 50,
    "batch_size": 100,
    "epochs": 1,
    "hidden": [8],
    "checkpoint_steps": 400,
    "evaluation_episodes": 4,
    "baselines": [],
}
FORECASTS: dict[str, Any] = {
    **SMALL,
    "env_config": {"physics": "closed_form"},
    "levels": ["default", "fast"],
    "total_steps": 0,
    "forecasts": {"episodes": 1000, "samples": 4, "updates": 300, "batch_size": 256},
}


def recipe(given: dict[str, Any], **changes: Any) -> TrainingConfig:
    return TrainingConfig.parse({**given, **changes}, "training setting")


def test_levels_come_from_the_command_line_and_the_recipe() -> None:
    config = TrainOptions("ppo/ObstacleDodge-v0", level="fast").resolve()
    assert config.conditions == [({"control_mode": "velocity"}, {"obstacle_speed": 1.5})]
    several = TrainOptions("ppo/ObstacleDodge-v0", ("levels=[default,three_discs]", "env_config.observed_discs=4"))
    own = {"control_mode": "velocity", "observed_discs": 4}
    assert several.resolve().conditions == [(own, {}), ({"num_obstacles": 3, **own}, {})]
    with pytest.raises(ValueError, match="unknown level"):
        TrainOptions("ppo/ObstacleDodge-v0", ("levels=[fats]",)).resolve().check_levels()
    with pytest.raises(ValueError, match="3 levels for 2 environments"):
        recipe(SMALL, levels=["fast", "large", "default"], num_envs=2).check_levels()


def test_every_episode_of_a_batch_has_the_options_of_its_level() -> None:
    config = recipe(SMALL, levels=["fast", "large"], num_envs=5)
    with closing(NativeVecEnv(training_batch(config))) as env:
        batches = env.env.batches  # type: ignore[attr-defined]
        assert [batch.num_envs for batch in batches] == [3, 2]
        env.seed(7)
        env.reset()
        ends = 0
        for _ in range(65):  # two episodes of 30 periods, and the next one
            _, _, ended, infos = env.step(np.zeros((5, 2), np.float32))
            ends += int(ended.sum())
            assert all(("terminal_observation" in info) == bool(over) for info, over in zip(infos, ended, strict=True))
            fast, large = (batch.unwrapped.task for batch in batches)
            for index in range(3):
                path = fast.obstacle_path(index)[:, 0]
                assert np.linalg.norm(np.diff(path, axis=0), axis=1).max() / fast.scale.path_step > 1.4
            assert (large.batch["radii"] == 0.2).all()
        assert ends >= 10


def test_a_batch_of_one_level_begins_the_episodes_of_the_plain_environment() -> None:
    config = recipe(SMALL, levels=["fast"])
    with closing(training_batch(config)) as env, closing(make_batch(config.env_id, 4, config.env_config)) as plain:
        actions = np.zeros((4, 2), np.float32)
        begun, _ = env.reset(seed=3)
        expected, _ = plain.reset(seed=3, options={"obstacle_speed": 1.5})
        np.testing.assert_array_equal(begun, expected)
        ended = np.zeros(4, dtype=bool)
        while not ended.any():
            observations, rewards, terminated, truncated, infos = env.step(actions)
            same, paid, *_, expected_infos = plain.step(actions)
            np.testing.assert_array_equal(rewards, paid)
            ended = terminated | truncated
        assert (infos["_final_obs"] == ended).all()
        for index in np.flatnonzero(ended):
            np.testing.assert_array_equal(infos["final_obs"][index], expected_infos["final_obs"][index])
            assert not np.array_equal(observations[index], same[index])  # the plain one goes on without the level


def test_levels_with_other_observations_are_refused_with_what_to_do() -> None:
    parts = [make_batch("ObstacleDodge-v0", 1, {"num_obstacles": discs}) for discs in (1, 2)]
    with pytest.raises(ValueError, match=r"observed_discs=4"):
        SideBySide(parts)
    for part in parts:
        part.close()


def test_a_run_with_a_warm_start_trains_at_several_levels(tmp_path: Path) -> None:
    warm_start = {"expert": "apf", "episodes": 3, "rounds": 2, "updates": 5, "batch_size": 32}
    config = recipe(SMALL, levels=["fast", "large"], warm_start=warm_start)
    run = TrainingRun.begin(tmp_path / "run", config, "test")
    assert run.train()
    assert run.steps == 400
    scores = evaluate(load_agent(tmp_path / "run"), "ObstacleDodge-v0", [1], options={"obstacle_radius": 0.2})
    assert len(scores.returns) == 1


@pytest.fixture(scope="module")
def forecasting(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("forecasts") / "run"
    assert TrainingRun.begin(folder, recipe(FORECASTS), "test").train()
    return folder


def test_an_agent_of_forecasts_acts_among_several_discs_alike_in_any_batch(forecasting: Path) -> None:
    settings = {"num_obstacles": 2, "observed_discs": 4, "physics": "closed_form"}
    together = evaluate(load_agent(forecasting), "ObstacleDodge-v0", [5, 6, 7], env_config=settings)
    alone = evaluate(load_agent(forecasting), "ObstacleDodge-v0", [6], env_config=settings)
    assert together.returns[1] == alone.returns[0]
    assert together.metrics["is_success"].any()


def test_forecasts_without_an_environment_are_refused(forecasting: Path) -> None:
    with pytest.raises(ValueError, match=r"for_env"):
        load_agent(forecasting).predict(np.zeros(40, np.float32))
    with pytest.raises(ValueError, match="trained with one disc"):
        TrainingRun.begin(forecasting.parent / "other", recipe(FORECASTS, levels=["two_discs"]), "test")
    with pytest.raises(ValueError, match=r"forecasts go without fine"):
        recipe(FORECASTS, fine={"clearance": 2.0})


ESTIMATES: dict[str, Any] = {
    **SMALL,
    "env": "ConveyorTrack-v0",
    "env_config": {"control_mode": "jerk"},
    "levels": ["default", "noise"],
    "estimates": True,
    "warm_start": {"expert": "apf", "episodes": 2, "rounds": 2, "updates": 20},
}


def test_a_policy_is_trained_on_estimates_where_it_will_act_on_them(tmp_path: Path) -> None:
    config = recipe(ESTIMATES)
    with closing(training_batch(config)) as env:
        assert [isinstance(batch, OnEstimates) for batch in env.batches] == [False, True]  # type: ignore[attr-defined]
    run = TrainingRun.begin(tmp_path, config, "test")
    assert run.train()
    agent = load_agent(tmp_path / "last.safetensors")
    settings = config.conditions[1][0]
    with closing(make_batch("ConveyorTrack-v0", 2, settings)) as env:
        assert isinstance(agent.for_env(env), FilteredPolicy)
    own = agent.document["training"]["config"] | {"estimates": False}
    document = {**agent.document, "training": {**agent.document["training"], "config": own}}
    with closing(make_batch("ConveyorTrack-v0", 2, settings)) as env:
        assert not isinstance(replace(agent, document=document).for_env(env), FilteredPolicy)


@pytest.mark.parametrize(
    "changes",
    [
        {"levels": ["noise", "latency"]},
        {"levels": [], "env_config": {"control_mode": "jerk", "encoder_noise": 5e-5, "latency": (0.0, 0.02)}},
    ],
)
def test_without_a_level_without_uncertainty_it_learns_from_an_expert_in_the_plain_task(
    changes: dict[str, Any],
) -> None:
    assert certain_conditions(recipe(ESTIMATES, **changes)) == [({"control_mode": "jerk"}, {})]


def test_datasets_hold_no_estimates() -> None:
    with pytest.raises(ValueError, match="a dataset holds no estimates: with estimates, give warm_start an expert"):
        check_estimates(recipe(ESTIMATES, warm_start={"dataset": "some/dataset-v0"}))


@pytest.mark.parametrize(
    "changes", [{"levels": ["default", "fast"]}, {"env_config": {}}, {**SMALL, "levels": ["noise"], "estimates": True}]
)
def test_estimates_where_there_are_none_are_refused(changes: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="give a level such as noise, or leave estimates out"):
        TrainingRun.begin(tmp_path, recipe(ESTIMATES, **changes), "test")
