"""Models of Stable-Baselines3 exported as agents act as before; what an agent cannot be is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import agents
from agents import Agent, export_agent, load_agent, save_agent
from agents.cli import main
from agents.policies.agent import FORMAT, NORMALIZED, SQUASHED_FORMAT
from agents.policies.sb3 import load_model

sb3 = pytest.importorskip("stable_baselines3", reason='needs pip install "planarm[rl]"')
torch = pytest.importorskip("torch")

from stable_baselines3.common.torch_layers import BaseFeaturesExtractor  # noqa: E402
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize  # noqa: E402

pytestmark = pytest.mark.rl
ENV = "ConveyorTrack-v0"
SETTINGS: dict[str, Any] = {"control_mode": "jerk", "horizon": 2.0}
FORMATS = {
    "PPO": FORMAT,
    "A2C": FORMAT,
    "SAC": SQUASHED_FORMAT,
    "TD3": SQUASHED_FORMAT,
    "DDPG": SQUASHED_FORMAT,
}


def make(algorithm: str = "PPO", env: Any = None, policy: str = "MlpPolicy", **more: Any) -> Any:
    """A model with weights at random, of which those of the output are large."""
    env = gym.make(ENV, **SETTINGS) if env is None else env
    given = {"policy_kwargs": {"net_arch": [16, 8]}, "seed": 1, "device": "cpu", **more}
    model = getattr(sb3, algorithm)(policy, env, **given)
    with torch.no_grad():
        for parameter in model.policy.parameters():
            parameter.copy_(torch.randn(parameter.shape, generator=torch.Generator().manual_seed(3)) * 0.5)
    return model


def observations(count: int = 300) -> np.ndarray[Any, Any]:
    size = gym.make(ENV).observation_space.shape[0]  # type: ignore[index]
    return np.random.default_rng(0).normal(0.0, 1.5, (count, size)).astype(np.float32)


def assert_same_actions(agent: Agent, model: Any) -> None:
    seen = observations()
    expected = model.predict(seen, deterministic=True)[0]
    actions = agent.predict(seen, deterministic=True)[0]
    assert (np.abs(expected) < 0.99).mean() > 0.2
    assert actions.dtype == np.float32
    np.testing.assert_allclose(actions, expected, rtol=0.0, atol=5e-6)


@pytest.mark.parametrize("algorithm", FORMATS)
def test_an_exported_model_acts_as_before(algorithm: str, tmp_path: Path) -> None:
    model = make(algorithm)
    exported = export_agent(model, ENV)
    assert exported.document["format"] == FORMATS[algorithm]
    assert exported.env_config == SETTINGS
    assert exported.document["training"] == {"algorithm": algorithm, "seed": 1, "steps": 0}
    assert_same_actions(exported, model)
    save_agent(exported, tmp_path / "agent.safetensors")
    assert_same_actions(load_agent(tmp_path / "agent.safetensors"), model)


@pytest.mark.parametrize("algorithm", ["A2C", "DDPG", "SAC"])
def test_a_zip_is_exported_with_the_settings_that_are_given(algorithm: str, tmp_path: Path) -> None:
    model = make(algorithm)
    model.save(tmp_path / "model.zip")
    exported = export_agent(load_model(tmp_path / "model.zip", ENV, allow_code=True), ENV, env_config=SETTINGS)
    assert exported.action_config == {"control_mode": "jerk"}
    assert_same_actions(exported, model)


def test_the_command_exports_a_zip_in_the_settings_that_are_given(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = make()
    model.save(tmp_path / "model.zip")
    command = ["submit", "export", str(tmp_path / "model.zip"), str(tmp_path / "mine"), "--env", ENV]
    assert main(command) == 2
    assert "pass --allow-code" in capsys.readouterr().err
    assert main([*command, "--allow-code"]) == 2
    assert "does not say in which control mode it was trained" in capsys.readouterr().err
    assert main([*command, "--allow-code", "--settings", "control_mode=jerk", "horizon=2.0"]) == 0
    assert_same_actions(load_agent(tmp_path / "mine" / "agent.safetensors"), model)


@pytest.mark.parametrize("layers", [[], [7], {"pi": [9, 5], "vf": [3]}], ids=str)
@pytest.mark.parametrize("activation", ["Tanh", "ReLU"])
def test_layers_and_activations_are_the_models(layers: Any, activation: str) -> None:
    model = make(policy_kwargs={"net_arch": layers, "activation_fn": getattr(torch.nn, activation)})
    assert_same_actions(export_agent(model, ENV), model)


@pytest.mark.parametrize("algorithm", ["PPO", "SAC"])
def test_statistics_of_vecnormalize_become_part_of_the_agent(algorithm: str, tmp_path: Path) -> None:
    venv = VecNormalize(DummyVecEnv([lambda: gym.make(ENV, **SETTINGS)]), clip_obs=1.5)
    model = make(algorithm, venv)
    venv.obs_rms.mean, venv.obs_rms.var = np.linspace(-0.5, 0.5, 18), np.linspace(0.2, 4.0, 18)
    exported = export_agent(model, ENV)
    assert exported.document["format"] == FORMATS[algorithm] + NORMALIZED
    save_agent(exported, tmp_path / "agent.safetensors")
    loaded = load_agent(tmp_path / "agent.safetensors")
    seen = observations()
    expected = model.predict(venv.normalize_obs(seen), deterministic=True)[0]
    np.testing.assert_allclose(loaded.predict(seen, deterministic=True)[0], expected, rtol=0.0, atol=5e-6)
    assert (np.abs(venv.normalize_obs(seen)) == 1.5).any()
    model.save(tmp_path / "model.zip")
    venv.save(tmp_path / "vecnormalize.pkl")
    again = export_agent(load_model(tmp_path / "model.zip", ENV, allow_code=True), ENV, env_config=SETTINGS)
    np.testing.assert_array_equal(again.predict(seen, deterministic=True)[0], loaded.predict(seen, None, None, True)[0])


def test_an_exported_agent_scores_what_the_model_does() -> None:
    model = make()
    own, exported = (agents.evaluate(policy, ENV, range(4)) for policy in (model, export_agent(model, ENV)))
    np.testing.assert_allclose(exported.returns, own.returns, rtol=1e-3)


class Squares(BaseFeaturesExtractor):  # type: ignore[misc]
    def __init__(self, observation_space: Any) -> None:
        super().__init__(observation_space, observation_space.shape[0])

    def forward(self, seen: Any) -> Any:
        return seen * seen


def in_a_dictionary() -> Any:
    env = gym.make(ENV, **SETTINGS)
    space = gym.spaces.Dict({"all": env.observation_space})
    return gym.wrappers.TransformObservation(env, lambda seen: {"all": seen}, space)


@pytest.mark.parametrize(
    ("more", "complaint"),
    [
        ({"policy_kwargs": {"activation_fn": torch.nn.ELU}}, "layer 1 of the policy is ELU"),
        ({"policy_kwargs": {"features_extractor_class": Squares}}, "features come from Squares"),
        ({"use_sde": True}, "use_sde=True cannot be exported"),
        (
            {"env": in_a_dictionary(), "policy": "MultiInputPolicy"},
            r"an observation space of another kind \(Dict\) than that of ConveyorTrack-v0",
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_an_agent_cannot_be_is_refused(more: dict[str, Any], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        export_agent(make(**more), ENV)


def test_a_policy_of_another_class_is_refused() -> None:
    from stable_baselines3.common.policies import ActorCriticPolicy

    class Recurrent(ActorCriticPolicy):  # type: ignore[misc]
        pass

    with pytest.raises(ValueError, match=r"of the class Recurrent cannot be exported: .* without memory"):
        export_agent(sb3.PPO(Recurrent, gym.make(ENV), n_steps=8, batch_size=8), ENV)


def test_a_model_of_another_environment_and_diverged_weights_are_refused() -> None:
    with pytest.raises(ValueError, match=r"another shape \(18,\) than that of ObstacleDodge-v0, \(36,\)"):
        export_agent(make(), "ObstacleDodge-v0")
    model = make()
    with torch.no_grad():
        model.policy.action_net.bias[0] = float("nan")
    with pytest.raises(ValueError, match=r"layer2\.bias of an agent holds values that are not finite"):
        export_agent(model, ENV)
