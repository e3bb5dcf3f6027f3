"""Models of Stable-Baselines3: loaded from their zips, with the statistics of their VecNormalize."""

from __future__ import annotations

import json
import pickle  # nosec B403: only behind allow_code
import zipfile
from contextlib import closing
from importlib import import_module
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from agents.policies.policy import NormalizedPolicy, Policy
from planners.checks import brief

STATISTICS = ("vecnormalize.pkl", "vec_normalize.pkl")
"""Files beside a model with the statistics of its VecNormalize.

``MODEL_vecnormalize.pkl`` comes first; last are those in the folder ``MODEL``, where rl-baselines3-zoo writes them."""

_MARKS = {"clip_range": "PPO", "target_entropy": "SAC", "target_policy_noise": "TD3", "vf_coef": "A2C"}
"""The algorithm of a model by a setting that it has, the first that applies; DDPG's are loaded as TD3's."""


def load_model(path: Path, env_id: str, *, allow_code: bool) -> Policy:
    """A model of Stable-Baselines3, which acts on the CPU.

    Its algorithm is inferred from its settings, which do not name it. Statistics of a VecNormalize beside it are used.

    Raises:
        ValueError: if there is no such file, it may not be opened, it is no model, or its statistics are missing.
        ModuleNotFoundError: without the `rl` extra.
    """
    if not path.is_file():
        raise ValueError(f"no file {path}")
    if not allow_code:
        raise ValueError(
            f"{path} is not loaded: the zip of a Stable-Baselines3 model can run any code when it is opened. If you "
            "trust its source, pass --allow-code, in Python allow_code=True"
        )
    try:
        with zipfile.ZipFile(path) as archive:
            settings = dict(json.loads(archive.read("data")))
    except Exception as error:  # a damaged file can fail in any way
        raise ValueError(f"{path} is no model of Stable-Baselines3: {brief(error)}") from None
    algorithm = next((name for mark, name in _MARKS.items() if mark in settings), None)
    if algorithm is None:
        raise ValueError(f"{path} is of no algorithm known here ({', '.join(_MARKS.values())})")
    try:
        library = import_module("stable_baselines3")
        import_module("torch").set_num_threads(1)
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(f'a Stable-Baselines3 model needs pip install "planarm[rl]" ({error})') from None
    try:
        model = getattr(library, algorithm).load(path, device="cpu")
    except Exception as error:  # a damaged file can fail in any way
        raise ValueError(f"{path} is damaged, or of another version: {type(error).__name__}") from None
    return _with_statistics(model, path, env_id)


def statistics_names(stem: str) -> tuple[str, ...]:
    """Names of files beside a model, called ``stem``, that would hold the statistics of its VecNormalize."""
    return f"{stem}_vecnormalize.pkl", *STATISTICS, *(f"{stem}/{name}" for name in STATISTICS)


def _with_statistics(model: Any, path: Path, env_id: str) -> Policy:
    """A model with the statistics beside it, if there are any; a ValueError if it was trained with some."""
    names = [path.parent / name for name in statistics_names(path.stem)]
    found = next((name for name in names if name.is_file()), None)
    models = [each.name for each in path.parent.glob("*.zip")]
    if found is not None and found.parent == path.parent and found.name in STATISTICS and len(models) > 1:
        raise ValueError(
            f"{found} lies beside {len(models)} models, and does not say whose statistics it holds: call it "
            f"{path.stem}_vecnormalize.pkl if it is of {path.name}, or move the models apart"
        )
    if found is None:
        if _looks_normalized(model, env_id):
            raise ValueError(
                f"{path} was trained behind a VecNormalize, whose statistics are not beside it: save them there with "
                f"model.get_vec_normalize_env().save({str(path.with_name(STATISTICS[0]))!r}); if there was none, save "
                "the model again after model._last_original_obs = None"
            )
        plain: Policy = model
        return plain
    try:
        statistics = pickle.loads(found.read_bytes())  # nosec B301: load_model refuses without allow_code
        normalize, shape = statistics.normalize_obs, statistics.observation_space.shape
    except Exception as error:
        raise ValueError(f"{found} holds no statistics of a VecNormalize: {type(error).__name__}: {error}") from None
    if not callable(normalize) or shape != model.observation_space.shape:
        raise ValueError(f"{found} is for observations of shape {shape}; {path} takes {model.observation_space.shape}")
    return NormalizedPolicy(model, statistics)


def _looks_normalized(model: Any, env_id: str) -> bool:
    """Whether the last observation of a model differs from that before normalisation in every element but zeros.

    PPO and A2C keep the latter only where there is a VecNormalize. SAC, TD3 and DDPG without one keep the observation
    of one step before instead, which has elements in common with the last: what is constant in an episode. Where an
    episode has just begun, the last one has elements in common with every first observation, such as the time left.
    """
    last, original = model._last_obs, model._last_original_obs
    if original is None or np.any((last == original) & (original != 0.0)):
        return False
    with closing(gym.make(env_id)) as env:
        first = np.array([env.reset(seed=seed)[0] for seed in range(3)])
    if first.shape[1:] != np.shape(last)[1:]:  # in other settings
        return True
    common = (first == first[0]).all(axis=0) & (first[0] != 0.0)
    return not (common.any() and (last == first[0])[:, common].all())
