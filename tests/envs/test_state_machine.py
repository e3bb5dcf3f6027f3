"""Calls in any order, single and vector, against a model of what is allowed and against a twin that replays them."""

from __future__ import annotations

import copy
import pickle
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, precondition, rule, run_state_machine_as_test

import envs

SETTINGS: dict[str, dict[str, Any]] = {
    "ConveyorTrack-v0": {"horizon": 1.0, "hold_time": 0.1},
    "MinTorqueMove-v0": {},
    "ObstacleDodge-v0": {},
    "ExcavatorPayload-v0": {"horizon": 1.0},
}
BAD_ACTIONS = [np.nan, "x", None]
seeds = st.integers(0, 3)


def result(value: Any) -> str:
    return repr(value)


class Calls(RuleBasedStateMachine):
    """The environment, and its model: whether it has begun, is over or closed, and a log that a fresh one replays."""

    env_id: str
    num_envs: int

    def __init__(self) -> None:
        super().__init__()
        self.env = self.made()
        self.begun = self.over = self.closed = False
        self.log: list[tuple[str, Any, str]] = []
        self.kept: list[tuple[Any, bool, list[tuple[str, Any, str]]]] = []

    def made(self) -> Any:
        config = SETTINGS[self.env_id]
        if self.num_envs:
            return gym.make_vec(self.env_id, num_envs=self.num_envs, **config)
        return gym.make(self.env_id, disable_env_checker=True, **config).unwrapped

    def shape(self) -> tuple[int, ...]:
        return tuple(self.env.action_space.shape)

    def refused(self, call: Any, *kinds: type[Exception]) -> None:
        before = self.env.get_state()
        with pytest.raises(kinds):
            call()
        assert self.env.get_state() == before

    def reset_or_refused(self, arguments: dict[str, Any]) -> None:
        if self.closed:
            self.refused(lambda: self.env.reset(**arguments), gym.error.ClosedEnvironmentError)
            return
        self.log.append(("reset", arguments, result(self.env.reset(**arguments))))
        self.begun, self.over = True, False

    @rule(seed=seeds)
    def reset_with_a_seed(self, seed: int) -> None:
        if not self.closed:
            self.log = []  # all before is forgotten
        self.reset_or_refused({"seed": seed})

    @precondition(lambda self: self.begun or self.closed)
    @rule()
    def reset(self) -> None:
        self.reset_or_refused({})

    @precondition(lambda self: not self.closed)
    @rule(options=st.sampled_from([{"scenario": "papr"}, {"nothing": 1}, 3]))
    def reset_with_bad_options(self, options: Any) -> None:
        self.refused(lambda: self.env.reset(seed=1, options=options), ValueError)

    @rule(share=st.floats(-1.0, 1.0), times=st.integers(1, 30))
    def step(self, share: float, times: int) -> None:
        action = np.full(self.shape(), 0.2 * share, dtype=np.float32)
        for _ in range(times):
            if self.closed:
                self.refused(lambda: self.env.step(action), gym.error.ClosedEnvironmentError)
                return
            if not self.begun or self.over:
                self.refused(lambda: self.env.step(action), gym.error.ResetNeeded)
                return
            step = self.env.step(action)
            self.log.append(("step", action, result(step)))
            self.over = not self.num_envs and (step[2] or step[3])

    @precondition(lambda self: self.begun and not self.over and not self.closed)
    @rule(bad=st.sampled_from(BAD_ACTIONS))
    def step_with_a_bad_action(self, bad: Any) -> None:
        self.refused(lambda: self.env.step(np.full(self.shape(), bad)), ValueError)
        self.refused(lambda: self.env.step(np.zeros(7)), ValueError)

    @rule()
    def render(self) -> None:
        if self.closed:
            self.refused(self.env.render, gym.error.ClosedEnvironmentError)
        elif not self.begun:
            self.refused(self.env.render, gym.error.ResetNeeded)
        elif self.num_envs:
            assert self.env.render() is None

    @rule()
    def keep(self) -> None:
        if self.begun:
            self.kept.append((self.env.get_state(), self.over, list(self.log)))

    @precondition(lambda self: self.kept)
    @rule(data=st.data())
    def go_back(self, data: st.DataObject) -> None:
        state, over, log = data.draw(st.sampled_from(self.kept))
        if self.closed:
            self.refused(lambda: self.env.set_state(state), gym.error.ClosedEnvironmentError)
            return
        self.env.set_state(pickle.loads(pickle.dumps(state)))
        self.begun, self.over, self.log = True, over, list(log)
        assert self.env.get_state() == state

    @rule(deep=st.booleans())
    def go_on_with_a_copy(self, deep: bool) -> None:
        old = self.env
        self.env = copy.deepcopy(old) if deep else pickle.loads(pickle.dumps(old))
        assert self.env.get_state() == old.get_state()
        old.close()

    @rule(sure=st.integers(0, 9))
    def close(self, sure: int) -> None:
        if sure == 0:
            self.env.close()
            self.env.close()
            self.begun, self.closed = False, True

    def teardown(self) -> None:
        twin = self.made()
        for call, argument, expected in self.log:
            found = twin.reset(**argument) if call == "reset" else twin.step(argument)
            assert result(found) == expected
        self.env.close()
        twin.close()


@pytest.mark.parametrize("num_envs", [0, 3])
@pytest.mark.parametrize("env_id", envs.env_ids())
def test_calls_in_any_order(env_id: str, num_envs: int) -> None:
    kind = type("CallsOfOne", (Calls,), {"env_id": env_id, "num_envs": num_envs})
    explores = not settings().derandomize
    run_state_machine_as_test(  # type: ignore[no-untyped-call]
        kind,
        settings=settings(
            max_examples=100 if explores else 10,
            stateful_step_count=25,
            deadline=None,
            suppress_health_check=list(HealthCheck),
        ),
    )
