"""Models of Stable-Baselines3 behind the statistics of their VecNormalize."""

from __future__ import annotations

from typing import Any


class NormalizedPolicy:
    """A model behind the observation statistics that it was trained with."""

    def __init__(self, model: Any, statistics: Any) -> None:
        self.observation_space, self.action_space = model.observation_space, model.action_space
        self.model, self.statistics = model, statistics

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = False
    ) -> tuple[Any, Any]:
        """As the model's, for observations as the environment gives them."""
        seen = self.statistics.normalize_obs(observation)
        answer: tuple[Any, Any] = self.model.predict(seen, state, episode_start, deterministic)
        return answer


def normalized(policy: Any) -> Any:
    """A policy; a model whose environment has a VecNormalize, behind the statistics of that."""
    own = getattr(policy, "get_vec_normalize_env", None)
    statistics = own() if callable(own) else None
    return policy if statistics is None else NormalizedPolicy(policy, statistics)
