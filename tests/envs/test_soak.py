"""A share of `tools.soak`: random steps of every environment and mode, and environments made and closed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import envs
from tools.soak import BLOCK, Soak, make_and_close, modes_of, patterns, soak

FEW = Soak(steps=16 * BLOCK, closes=12, num_envs=16)


@pytest.mark.parametrize(("env_id", "mode"), [(env_id, mode) for env_id in envs.env_ids() for mode in modes_of(env_id)])
def test_random_steps_stay_finite_and_inside_the_observation_space(env_id: str, mode: str) -> None:
    for autoreset_mode in ("SameStep", "NextStep"):
        record = soak(env_id, mode, replace(FEW, autoreset_mode=autoreset_mode))  # type: ignore[arg-type]
        assert record.faults == []
        assert record.count == FEW.steps


@pytest.mark.parametrize("kind", ["single", "batch", "rendered"])
def test_environments_leave_nothing_behind_when_they_are_closed(kind: str) -> None:
    if kind == "rendered":
        pytest.importorskip("pygame")
    record = make_and_close(kind, FEW)
    assert record.faults == []
    assert record.count == FEW.closes


def test_patterns_hold_actions_of_every_size() -> None:
    actions = patterns(np.random.default_rng(0), 256, (2,))
    assert actions.shape == (BLOCK, 256, 2)
    assert np.isfinite(actions).all()
    assert np.abs(actions).max() > 1e30
    assert (actions == 0.0).all(axis=(0, 2)).any()


def test_a_soak_finds_an_observation_outside_its_space(monkeypatch: pytest.MonkeyPatch) -> None:
    from envs.vector_environment import PlanarArmVectorEnv

    step = PlanarArmVectorEnv.step

    def broken(self: PlanarArmVectorEnv, actions: np.ndarray) -> tuple:  # type: ignore[type-arg]
        observations, *others = step(self, actions)
        observations[0, 0] = np.nan
        return observations, *others

    monkeypatch.setattr(PlanarArmVectorEnv, "step", broken)
    assert soak("MinTorqueMove-v0", "torque", FEW).faults
