"""Where the networks of a run are trained: the device and the number of threads of PyTorch."""

from __future__ import annotations

import os

import torch

from agents.training.recipe import TrainingConfig

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
    if threads == "auto":
        threads = min(processors() // 2, MOST_THREADS) if large and processors() >= MANY_PROCESSORS else 1
    return config.model_copy(update={"device": device, "threads": threads})


def use(config: TrainingConfig) -> None:
    """Set PyTorch to the threads of a resolved recipe.

    Raises:
        ValueError: if its device is missing.
    """
    if config.device == "cuda" and not torch.cuda.is_available():
        raise ValueError(
            f"device cuda: PyTorch {torch.__version__} finds no GPU that it can use; take device=cpu, or install "
            "PyTorch with CUDA and a driver"
        )
    torch.set_num_threads(int(config.threads))


def processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def described(config: TrainingConfig) -> dict[str, object]:
    """The device and the threads of a resolved recipe, and the GPU's name, for run.json."""
    gpu = {"gpu": torch.cuda.get_device_name()} if config.device == "cuda" else {}
    return {"device": config.device, "threads": config.threads, **gpu}
