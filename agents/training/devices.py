"""Where the networks of a run are trained: the device and the number of threads."""

from __future__ import annotations

import os

import torch

from agents.training.gradients import chunks
from agents.training.recipe import PPOConfig, TrainingConfig

LARGE_BATCH = 4096  # samples of a minibatch from which a GPU, or more threads on many processors, are faster
MANY_PROCESSORS, MOST_THREADS = 8, 8


def resolved(config: TrainingConfig) -> TrainingConfig:
    """A recipe with its device and threads as this machine has them.

    Raises:
        ValueError: for ``cuda`` where PyTorch finds no GPU.
    """
    large = config.batch_size >= LARGE_BATCH
    device, threads = config.device, config.threads
    if device == "auto":
        device = "cuda" if large and torch.cuda.is_available() else "cpu"
    if threads == "auto" and isinstance(config, PPOConfig):
        fits = [config.batch_size, *(fit.batch_size for fit in (config.warm_start, config.amortise) if fit)]
        threads = min(processors(), MOST_THREADS, len(chunks(max(fits))))
    elif threads == "auto":
        threads = min(processors() // 2, MOST_THREADS) if large and processors() >= MANY_PROCESSORS else 1
    return config.model_copy(update={"device": device, "threads": threads})


def use(config: TrainingConfig) -> None:
    """Set PyTorch to the threads of a resolved recipe; PPO shares its minibatches among threads itself.

    Raises:
        ValueError: if its device is missing.
    """
    if config.device == "cuda" and not torch.cuda.is_available():
        raise ValueError(
            f"device cuda: PyTorch {torch.__version__} finds no GPU that it can use; take device=cpu, or install "
            "PyTorch with CUDA and a driver"
        )
    torch.set_num_threads(1 if isinstance(config, PPOConfig) else thread_count(config))


def thread_count(config: TrainingConfig) -> int:
    """The threads of a recipe as a number, on this machine if they are ``auto``."""
    return int(resolved(config).threads)


def processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def described(config: TrainingConfig) -> dict[str, object]:
    """The device and the threads of a resolved recipe, and the GPU's name, for run.json."""
    gpu = {"gpu": torch.cuda.get_device_name()} if config.device == "cuda" else {}
    return {"device": config.device, "threads": config.threads, **gpu}
