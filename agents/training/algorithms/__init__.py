"""The algorithms of Stable-Baselines3 for runs in segments: `make_model` makes the one that a recipe names."""

from __future__ import annotations

from agents.training.algorithms.off_policy import SegmentedSAC, SegmentedTD3
from agents.training.algorithms.ppo import SegmentedPPO
from agents.training.algorithms.segmented import Segmented
from agents.training.recipe import PPOConfig, SACConfig, TD3Config, TrainingConfig
from agents.training.vec_env import NativeVecEnv
from envs.observation import Layout


def make_model(config: TrainingConfig, env: NativeVecEnv, layout: Layout, device: str = "cpu") -> Segmented:
    """The algorithm of a recipe with networks at random, on a device of PyTorch."""
    match config:
        case PPOConfig():
            return SegmentedPPO(config, env, layout, device)
        case SACConfig():
            return SegmentedSAC(config, env, layout, device)
        case TD3Config():
            return SegmentedTD3(config, env, layout, device)
    raise TypeError(f"{type(config).__name__} is the recipe of no algorithm")
