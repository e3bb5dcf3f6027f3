"""Who takes part in a comparison: experts, trained agents, and models that users have trained themselves."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

from agents.evaluation.evaluate import Policy, PolicyMaker
from agents.policies.agent import Agent, load_agent, shipped_agents
from envs.experts import expert_names, is_expert
from envs.settings import refuse_unknown

SHIPPED = "agent"
"""The name of the agent that comes with planarm for the environment at hand."""

_SB3_MARKS = {"clip_range": "PPO", "target_entropy": "SAC", "target_policy_noise": "TD3", "vf_coef": "A2C"}
"""A setting by which the models of each algorithm are known, the telling ones first; DDPG's are loaded as TD3's."""


@dataclass(frozen=True)
class NamedPolicy:
    """A policy and what it needs.

    Attributes:
        name: of its row.
        policy: the name of an expert, anything with Stable-Baselines3's ``predict``, or what makes one.
        action_config: settings of the environment that say what its actions mean.
    """

    name: str
    policy: Policy | PolicyMaker | str
    action_config: Mapping[str, Any] = field(default_factory=dict)

    @property
    def is_expert(self) -> bool:
        """Whether it is scripted."""
        return isinstance(self.policy, str)

    def settings(self, env_config: Mapping[str, Any]) -> dict[str, Any]:
        """The settings of a task, with its actions.

        Raises:
            ValueError: if the task fixes another meaning of actions.
        """
        for name, value in self.action_config.items():
            if env_config.get(name, value) != value:
                raise ValueError(
                    f"{self.name} was trained with {name} {value!r} and can do nothing with {env_config[name]!r}; "
                    f"leave {name} out, so that each policy has its own"
                )
        return {**env_config, **self.action_config}


def find_policy(source: str, env_id: str, *, allow_code: bool = False) -> NamedPolicy:
    """A policy by name or by path.

    Args:
        source: the name of an expert, with ``+adaptive`` behind it for one that weighs the payload; ``agent`` for the
            agent shipped for the environment; the path of a training run's folder, of an agent (.safetensors), or of a
            model of Stable-Baselines3 (.zip).
        env_id: where it shall act.
        allow_code: whether to load a model of Stable-Baselines3, which runs whatever code its file holds.

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
    """A model of Stable-Baselines3; its algorithm is told by its settings, which hold no name."""
    if not allow_code:
        raise ValueError(
            f"{path} is not loaded: the zip of a Stable-Baselines3 model can run any code when it is opened. If you "
            "trust whoever made it, allow that with --allow-code"
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
