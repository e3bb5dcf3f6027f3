"""Policies by name or path: experts, trained agents, and models of Stable-Baselines3."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

from agents.evaluation.evaluate import Policy, PolicyMaker
from agents.policies.agent import Agent
from agents.policies.files import load_agent, shipped_agents
from envs.experts import expert_names, is_expert
from envs.settings import refuse_unknown

SHIPPED = "agent"  # name of the agent shipped with planarm for the environment

_SB3_MARKS = {"clip_range": "PPO", "target_entropy": "SAC", "target_policy_noise": "TD3", "vf_coef": "A2C"}
"""The algorithm of a model by a setting that it has, the first that applies; DDPG's are loaded as TD3's."""


@dataclass(frozen=True)
class NamedPolicy:
    """A policy as `agents.evaluate` takes it, its name, and the settings that define what its actions mean."""

    name: str
    policy: Policy | PolicyMaker | str
    action_config: Mapping[str, Any] = field(default_factory=dict)

    @property
    def is_expert(self) -> bool:
        """Whether it is a scripted expert."""
        return isinstance(self.policy, str)

    def settings(self, env_config: Mapping[str, Any]) -> dict[str, Any]:
        """The settings of an environment, with those of the policy's actions; a ValueError if they contradict."""
        for name, value in self.action_config.items():
            if env_config.get(name, value) != value:
                raise ValueError(
                    f"{self.name} was trained with {name} {value!r} and cannot act with {env_config[name]!r}; "
                    f"leave {name} out, so that each policy has its own"
                )
        return {**env_config, **self.action_config}


def find_policy(source: str, env_id: str, *, allow_code: bool = False) -> NamedPolicy:
    """A policy by name or by path.

    Args:
        source: the name of an expert, with ``+adaptive`` behind it for online payload estimation; ``agent`` for the
            agent shipped for the environment; the path of a training run's folder, of an agent (.safetensors), or of a
            model of Stable-Baselines3 (.zip).
        env_id: of the environment that it acts in.
        allow_code: whether to load a model of Stable-Baselines3, which can run any code in its file.

    Raises:
        ValueError: if there is none, it was trained on another environment, or it may not be loaded.
        ModuleNotFoundError: for a model of Stable-Baselines3 without the `rl` extra.
    """
    if is_expert(source):
        return NamedPolicy(source, source)
    if source.endswith(".zip"):
        return NamedPolicy(Path(source).stem, _load_sb3(Path(source), allow_code=allow_code))
    if source == SHIPPED:
        refuse_unknown([env_id], shipped_agents(), "environment with an agent of its own")
        return _of_agent(SHIPPED, load_agent(env_id), env_id)
    if not (source.endswith(".safetensors") or Path(source).is_dir()):
        refuse_unknown(
            [source], [*expert_names(env_id), SHIPPED], "policy (or the path of a run, a .safetensors or a .zip)"
        )
    return _of_agent(Path(source).resolve().stem, load_agent(source), env_id)


def _of_agent(name: str, agent: Agent, env_id: str) -> NamedPolicy:
    if agent.env_id != env_id:
        raise ValueError(f"{name} was trained on {agent.env_id}, not on {env_id}")
    return NamedPolicy(name, agent, agent.action_config)


def _load_sb3(path: Path, *, allow_code: bool) -> Policy:
    """A model of Stable-Baselines3; its algorithm is inferred from its settings, which do not name it."""
    if not allow_code:
        raise ValueError(
            f"{path} is not loaded: the zip of a Stable-Baselines3 model can run any code when it is opened. If you "
            "trust its source, pass --allow-code"
        )
    try:
        with zipfile.ZipFile(path) as archive:
            settings = json.loads(archive.read("data"))
    except (OSError, KeyError, ValueError, zipfile.BadZipFile) as error:
        raise ValueError(f"{path} is no model of Stable-Baselines3: {error}") from None
    algorithm = next((name for mark, name in _SB3_MARKS.items() if mark in settings), None)
    if algorithm is None:
        raise ValueError(f"{path} is of no algorithm known here ({', '.join(_SB3_MARKS.values())})")
    try:
        library = import_module("stable_baselines3")
        import_module("torch").set_num_threads(1)
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(f'a Stable-Baselines3 model needs pip install "planarm[rl]" ({error})') from None
    policy: Policy = getattr(library, algorithm).load(path, device="cpu")
    return policy
