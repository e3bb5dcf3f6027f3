"""Threads that share a batch: the same bits whatever their number, one batch at a time, errors and forks."""

from __future__ import annotations

import multiprocessing
import os
import sys
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from numba import njit, types

import envs  # noqa: F401  (registers the ids)
from envs.batch import pool
from envs.batch.pool import BATCH, COUNT, JOB_SIZE, KERNEL, MODEL, NO_PURPOSE, WORK, Pool
from planners.compiled.calls import address_of

N_ENVS = 200


def rollout(num_envs: int = N_ENVS, steps: int = 40) -> np.ndarray[Any, Any]:
    vector = gym.make_vec("ObstacleDodge-v0", num_envs=num_envs)  # some episodes end, so that others go on alone
    observations, _ = vector.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (steps, num_envs, 2)).astype(np.float32)
    return np.stack([observations, *[vector.step(each)[0] for each in actions]])


@pytest.mark.parametrize("threads", [1, 2, 3, 7])
def test_any_number_of_threads_gives_the_same_bits(threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    expected = rollout()
    monkeypatch.setattr(pool, "_pools", [Pool(threads)])
    np.testing.assert_array_equal(rollout(), expected)


def test_two_batches_at_once_do_not_disturb_each_other() -> None:
    expected = rollout()
    with ThreadPoolExecutor(3) as others:
        for found in others.map(lambda _: rollout(), range(3)):
            np.testing.assert_array_equal(found, expected)


@njit(nogil=True)
def fail_at_the_hundredth(batch: Any, model: Any, first: int, last: int) -> None:
    for index in range(first, last):
        batch[index] += 1.0
        if index == 100:
            raise ValueError("no such motion")


def test_an_error_in_a_thread_reaches_the_caller_after_all_have_worked() -> None:
    batch, model = np.zeros(N_ENVS), np.zeros(1)
    kind: Any = types.float64[::1]  # type: ignore[misc]
    job = np.zeros(JOB_SIZE, np.int64)
    job[KERNEL] = address_of(fail_at_the_hundredth, kind, kind, types.int64, types.int64)
    job[BATCH], job[MODEL] = batch.ctypes.data, model.ctypes.data
    job[COUNT], job[WORK] = N_ENVS, NO_PURPOSE
    threads = Pool(3)
    for calls in (1, 2):
        with pytest.raises(ValueError, match="no such motion"):
            threads.work(job)
        assert (batch[:100] == calls).all()


def report(queue: Any) -> None:
    queue.put(rollout())


@pytest.mark.skipif(not hasattr(os, "fork") or sys.platform == "darwin", reason="needs a fork")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_forked_process_has_threads_of_its_own() -> None:
    expected, context = rollout(), multiprocessing.get_context("fork")
    queue = context.Queue()
    child = context.Process(target=report, args=(queue,))
    child.start()
    np.testing.assert_array_equal(queue.get(timeout=60), expected)
    child.join()
