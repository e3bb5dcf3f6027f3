"""Replay buffers: as files of NumPy arrays, written and read without pickle, and filled by an expert."""

from __future__ import annotations

import hashlib
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import envs
from agents.datasets.read import read_dataset
from agents.training.recipe import Demonstrations
from agents.training.vec_env import NativeVecEnv
from planners.files import whole_file

_ARRAYS = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")
_HEADERS = 4096  # bytes that the header of an array may take


def save_replay(path: Path, buffer: Any) -> str:
    """Write the filled part of a replay buffer of Stable-Baselines3 atomically, as .npz; the file's SHA-256."""
    filled = buffer.buffer_size if buffer.full else buffer.pos
    arrays = {name: getattr(buffer, name)[:filled] for name in _ARRAYS}
    with whole_file(path) as draft:
        np.savez(draft, allow_pickle=False, position=np.array([buffer.pos, filled]), **arrays)
        return _sha256(draft)


def load_replay(path: Path, sha256: str, buffer: Any) -> None:
    """Fill a replay buffer from the file of `save_replay` with this SHA-256.

    Raises:
        ValueError: if the file is missing, damaged, or of another buffer. Nothing larger than the buffer is read.
    """
    try:
        if _sha256(path) != sha256:
            raise ValueError("it is not the file that the checkpoint was written with")
        with zipfile.ZipFile(path) as archive:
            sizes = {entry.filename: entry.file_size for entry in archive.infolist()}
        kept = {name: getattr(buffer, name) for name in _ARRAYS}
        for name, array in kept.items():
            if sizes.get(f"{name}.npy", 0) > array.nbytes + _HEADERS:
                raise ValueError(f"{name} is larger than the buffer")
        if sizes.get("position.npy", 0) > _HEADERS:
            raise ValueError("position is too large")
        with np.load(path, allow_pickle=False) as file:
            position, filled = file["position"].tolist()
            for name, array in kept.items():
                values = file[name]
                if values.shape != (filled, *array.shape[1:]) or values.dtype != array.dtype:
                    raise ValueError(f"{name} has shape {values.shape} and type {values.dtype}")
                array[:filled] = values
        if not 0 <= position < buffer.buffer_size or filled not in (position, buffer.buffer_size):
            raise ValueError(f"position {position} of {filled} transitions")
    except (OSError, EOFError, KeyError, TypeError, ValueError, MemoryError, zipfile.BadZipFile) as error:
        raise ValueError(
            f"{path} is no replay buffer of this run: {error}; restore it, or delete the checkpoints to begin again"
        ) from None
    buffer.pos, buffer.full = position, filled == buffer.buffer_size


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def demonstrate(
    plan: Demonstrations, env: NativeVecEnv, buffer: Any, progress: Callable[[str], bool] = lambda line: True
) -> bool:
    """Fill a replay buffer with episodes of an expert or a dataset; whether it was completed.

    ``progress`` is called with a line before every control step and says whether to continue.
    """
    if plan.dataset is not None:
        _add_dataset(plan.dataset, plan.episodes, env.num_envs, buffer)
        return progress(f"demonstrations of {plan.dataset} are in the replay buffer")
    expert = envs.make_expert(plan.source, env.env)
    observations: Any = env.reset()
    state, begins, episodes = None, np.ones(env.num_envs, dtype=bool), 0
    while episodes < plan.episodes:
        if not progress(f"demonstrations of {plan.expert}: {episodes} of {plan.episodes} episodes"):
            return False
        actions, state = expert.predict(observations, state=state, episode_start=begins, deterministic=True)
        following: Any
        following, rewards, begins, infos = env.step(actions)
        last = following.copy()
        for env_index in np.flatnonzero(begins).tolist():
            last[env_index] = infos[env_index]["terminal_observation"]
        buffer.add(observations, last, actions, rewards, begins, infos)
        episodes, observations = episodes + int(begins.sum()), following
    return True


def _add_dataset(dataset: str, episodes: int, num_envs: int, buffer: Any) -> None:
    """Add transitions of a dataset, as many at a time as there are environments; a last few may be left out."""
    steps: list[tuple[Any, ...]] = []
    for episode in read_dataset(dataset, most=episodes):
        last = len(episode.actions) - 1
        for t, action in enumerate(episode.actions):
            info = {"TimeLimit.truncated": t == last and not episode.terminated}
            transition = episode.observations[t], episode.observations[t + 1], action, episode.rewards[t], t == last
            steps.append((*transition, info))
    for first in range(0, len(steps) - num_envs + 1, num_envs):
        *columns, infos = zip(*steps[first : first + num_envs], strict=True)
        buffer.add(*map(np.stack, columns), list(infos))
