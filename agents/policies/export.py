"""Models of Stable-Baselines3 as agents: safetensors and JSON that act without torch, and without code in the file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import closing
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from agents.environments import check_names, import_env, portable
from agents.policies.agent import FORMAT, NORMALIZED, SQUASHED_FORMAT, Agent
from agents.policies.files import check_agent, describe_layout, layout_of
from agents.policies.lookup import name_policy
from agents.policies.policy import NormalizedPolicy
from agents.provenance import versions

Tensors = dict[str, NDArray[Any]]


def export_agent(model: Any, env_id: str, *, env_config: Mapping[str, Any] | None = None) -> Agent:
    """An agent that acts as a model of Stable-Baselines3 does: PPO, A2C, SAC, TD3 or DDPG with an "MlpPolicy".

    Deterministic actions equal the model's to the rounding of float32. The observation statistics of a VecNormalize,
    that of the model's environment or that beside its zip, become part of the agent. `save_agent` writes it.

    Args:
        model: the model, or what `agents.policies.sb3.load_model` gives for a zip.
        env_id: the environment that it was trained on.
        env_config: settings of that environment; if left out, those of the environment that the model has.

    Raises:
        ValueError: for any other policy (images, dictionaries, memory, gSDE, own networks), weights that are not
            finite, or an environment with other observations or actions.
    """
    env_id = import_env(env_id)
    settings = name_policy(model, env_id).env_config if env_config is None else env_config
    check_names(env_id, settings, {})
    statistics = None
    if isinstance(model, NormalizedPolicy):
        model, statistics = model.model, model.statistics
    elif callable(getattr(model, "get_vec_normalize_env", None)):
        statistics = model.get_vec_normalize_env()
    _check_spaces(model, env_id, settings)
    layers, noise, squashed = _actor(model)
    tensors, hidden, activation = _network(layers)
    tensors |= {name: _array(tensor) for name, tensor in noise.items()}
    tensors |= {"fine.index": np.zeros(0, np.int64), "fine.gain": np.zeros(0, np.float32)}
    kind = SQUASHED_FORMAT if squashed else FORMAT
    if statistics is not None and statistics.norm_obs:
        kind += NORMALIZED
        tensors |= {
            "normal.mean": np.array(statistics.obs_rms.mean, np.float64),
            "normal.std": np.sqrt(np.array(statistics.obs_rms.var, np.float64) + statistics.epsilon),
            "normal.clip": np.array([statistics.clip_obs], np.float64),
        }
    document = {
        "format": kind,
        "env": env_id,
        "env_config": portable(settings),
        **describe_layout(layout_of(env_id, settings)),
        "activation": activation,
        "hidden": hidden,
        "training": {"algorithm": type(model).__name__, "seed": model.seed, "steps": int(model.num_timesteps)},
        "versions": versions(("stable-baselines3", "torch", "safetensors")),
    }
    return check_agent(Agent(document, tensors))


def _check_spaces(model: Any, env_id: str, settings: Mapping[str, Any]) -> None:
    """Raise a ValueError for a model of other observations or actions than the environment's."""
    with closing(gym.make(env_id, **settings)) as env:
        for name in ("observation_space", "action_space"):
            own, given = getattr(model, name, None), getattr(env, name)
            if own != given:
                kind = name.replace("_", " ")
                raise ValueError(
                    f"the model has an {kind} {_in_words(own, given)} than that of {env_id}, {given.shape}: name the "
                    "environment and the settings that it was trained in, without wrappers that change spaces"
                )


def _in_words(space: Any, expected: gym.Space[Any]) -> str:
    """How a space differs from the expected one."""
    if type(space) is not type(expected):
        return f"of another kind ({type(space).__name__})"
    return "with other bounds" if space.shape == expected.shape else f"of another shape {space.shape}"


def _actor(model: Any) -> tuple[list[Any], dict[str, Any], bool]:
    """The modules from observations to actions, the tensors of the noise, and whether tanh bounds the actions."""
    from stable_baselines3.common.policies import ActorCriticPolicy
    from stable_baselines3.common.torch_layers import FlattenExtractor
    from stable_baselines3.sac.policies import SACPolicy
    from stable_baselines3.td3.policies import TD3Policy

    policy, kind = model.policy, type(model.policy)
    if kind not in (ActorCriticPolicy, SACPolicy, TD3Policy):
        raise ValueError(
            f"a policy of the class {kind.__name__} cannot be exported: an agent is a network of fully connected "
            'layers without memory, the "MlpPolicy" of PPO, A2C, SAC, TD3 or DDPG'
        )
    if getattr(model, "use_sde", False):
        raise ValueError("a policy with use_sde=True cannot be exported: an agent has no state-dependent exploration")
    if kind is ActorCriticPolicy:
        features = policy.pi_features_extractor
        layers, noise = [*policy.mlp_extractor.policy_net, policy.action_net], {"log_std": policy.log_std}
    elif kind is SACPolicy:
        actor, features = policy.actor, policy.actor.features_extractor
        layers = [*actor.latent_pi, actor.mu]
        noise = {"log_std.weight": actor.log_std.weight, "log_std.bias": actor.log_std.bias}
    else:
        features, noise = policy.actor.features_extractor, {}
        *layers, last = policy.actor.mu
        if type(last).__name__ != "Tanh":
            layers = [*layers, last]  # refused as the activation of an output
    if type(features) is not FlattenExtractor:
        raise ValueError(
            f"a policy whose features come from {type(features).__name__} cannot be exported: an agent's network sees "
            "the observation itself"
        )
    return layers, noise, kind is not ActorCriticPolicy


def _network(layers: Iterable[Any]) -> tuple[Tensors, list[int], str]:
    """The tensors of linear layers, the widths of the hidden ones, and the activation between them."""
    tensors: Tensors = {}
    hidden: list[int] = []
    activations: list[str] = []
    for place, module in enumerate(layers):
        name = type(module).__name__
        if name == "Linear" and place % 2 == 0 and module.bias is not None:
            tensors[f"layer{len(hidden)}.weight"], tensors[f"layer{len(hidden)}.bias"] = (
                _array(module.weight),
                _array(module.bias),
            )
            hidden.append(int(module.out_features))
        elif name in ("Tanh", "ReLU") and place % 2 == 1:
            activations.append(name.lower())
        else:
            raise ValueError(
                f"layer {place} of the policy is {name}: an agent has linear layers with Tanh or with ReLU between them"
            )
    if len(set(activations)) > 1:
        raise ValueError("the policy has Tanh and ReLU: an agent has one activation for all layers")
    return tensors, hidden[:-1], activations[0] if activations else "tanh"


def _array(tensor: Any) -> NDArray[Any]:
    """A copy of a tensor of torch."""
    return np.array(tensor.detach().cpu().numpy())
