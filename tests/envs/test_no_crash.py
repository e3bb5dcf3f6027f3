"""No call on a public object ends the interpreter: each program runs in a process of its own and ends well."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from tests.pages import ROOT

MAKE = """
import copy, pickle, random, signal, sys, threading
import gymnasium as gym, numpy as np
import envs

def made(env_id, num_envs):
    return (gym.make_vec(env_id, num_envs=num_envs) if num_envs else gym.make(env_id)).unwrapped

def moved(env):
    env.reset(seed=0)
    for _ in range(3):
        env.step(np.full(env.action_space.shape, 0.01, dtype=np.float32))
    return env
"""

INTERRUPTS = """
# Steps, resets, states and pictures are interrupted, some twice in a row; then everything goes on as in a fresh one.
env_id, num_envs = sys.argv[1], int(sys.argv[2])
env = made(env_id, num_envs)
action = np.zeros(env.action_space.shape, dtype=np.float32)
left = 0  # interrupts of this round that are still to come

def interrupt(*_):
    global left
    if left > 0:
        left -= 1
        raise KeyboardInterrupt

signal.signal(signal.SIGALRM, interrupt)
state, draw, count = moved(env).get_state(), random.Random(0), 0
env.set_state(state)  # all is compiled
while count < 200:
    count += 1
    try:
        try:
            left = 2
            signal.setitimer(signal.ITIMER_REAL, draw.uniform(1e-4, 3e-3), 2e-4)
            while left:  # both may be lost in the release of an object of Chipmunk, where Python only reports them
                choice = draw.randrange(20)
                if choice == 0:
                    env.reset(seed=count)
                elif choice == 1:
                    env.get_state()
                elif choice == 2:
                    env.set_state(state)
                else:
                    try:
                        env.step(action)
                    except gym.error.ResetNeeded:
                        env.reset()
        except KeyboardInterrupt:
            left = 0
    except KeyboardInterrupt:  # the second one, on the way out of the first
        pass
signal.setitimer(signal.ITIMER_REAL, 0)
twin = made(env_id, num_envs)
assert moved(env).get_state() == moved(twin).get_state()
for _ in range(5):
    np.testing.assert_array_equal(env.step(action)[0], twin.step(action)[0])
env.close()
"""

THREADS = """
# Threads that use one environment get their turn or a RuntimeError, and what they get belongs together.
env_id, num_envs = sys.argv[1], int(sys.argv[2])
env = moved(made(env_id, num_envs))
state, refused, others = env.get_state(), [], []
action = np.zeros(env.action_space.shape, dtype=np.float32)
calls = [lambda: env.step(action), lambda: env.reset(seed=1), lambda: env.set_state(state), env.get_state,
         lambda: env.task.advance(), lambda: copy.deepcopy(env), lambda: pickle.dumps(env.task)]

def use(seed):
    draw = random.Random(seed)
    for _ in range(100):
        try:
            draw.choice(calls)()
        except RuntimeError as error:
            assert "let them take turns" in str(error), error
            refused.append(error)
        except gym.error.ResetNeeded:
            pass
        except BaseException as error:
            others.append(error)

threads = [threading.Thread(target=use, args=(seed,)) for seed in range(3)]
sys.setswitchinterval(1e-5)
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
assert refused and not others, others
moved(env).close()
for call in calls[:3]:
    try:
        call()
    except gym.error.ClosedEnvironmentError as error:
        assert "closed" in str(error)
    else:
        raise AssertionError("used after close()")
"""

OVERWRITTEN = """
# What is public cannot be written to, or does no harm.
env_id, num_envs = sys.argv[1], int(sys.argv[2])
env, twin = moved(made(env_id, num_envs)), moved(made(env_id, num_envs))
task, raised = env.task, 0
action = np.full(env.action_space.shape, 0.01, dtype=np.float32)

def attempt(deed):
    global raised
    try:
        deed()
    except (ValueError, TypeError, AttributeError, KeyError, IndexError, ZeroDivisionError):
        raised += 1

for records in (task.batch, task.model):
    for name in records.dtype.names:
        for value in (0, -1, 2**62, np.nan, np.inf, "x", None):
            attempt(lambda: records.__setitem__(name, value))
            attempt(lambda: records[name].__setitem__(Ellipsis, value))
            attempt(lambda: records[0].__setitem__(name, value))
    attempt(lambda: records.view(np.uint8).__setitem__(Ellipsis, 255))
    attempt(lambda: records.setflags(write=True))
    attempt(lambda: records[records.dtype.names[0]].setflags(write=True))
    attempt(lambda: records.__setitem__(Ellipsis, np.ones_like(records)))
    attempt(lambda: records.resize(10**6, refcheck=False))
    attempt(lambda: setattr(records, "dtype", np.uint8))
    attempt(lambda: setattr(records, "shape", (1, -1)))
assert not {"space", "ground", "links", "joints", "table"} & set(task.batch.dtype.names)
for name, value in (("batch", np.zeros(1)), ("model", None), ("num_envs", 10**6)):
    attempt(lambda: setattr(task, name, value))
count = task.num_envs
for index in (-1, -(2**62), count, 2**40, 2**62):
    for deed in (task.scene, task.hand_position, task.table):
        before = raised
        attempt(lambda: deed(index, ()) if deed == task.scene else deed(index))
        assert raised == before + 1, (deed, index)
    attempt(lambda: task.reset_envs([index], [np.random.default_rng(0)], {}))
attempt(lambda: task.reset_envs(range(count), [], {}))
for actions in (np.full(env.action_space.shape, np.nan), np.full(env.action_space.shape, 1e300)):
    attempt(lambda: task.advance(np.atleast_2d(actions)))
task.close()
for _ in range(5):
    attempt(task.advance)
assert raised > 50
assert moved(env).get_state() == moved(twin).get_state()
for _ in range(3):
    np.testing.assert_array_equal(env.step(action)[0], twin.step(action)[0])
try:
    made(env_id, num_envs).task.advance()
except gym.error.ResetNeeded:
    pass
else:
    raise AssertionError("advanced before an episode")
"""


def run(program: str, *arguments: object) -> None:
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-W", "error", "-X", "faulthandler", "-c", MAKE + program, *map(str, arguments)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, f"exit status {done.returncode}\n{done.stderr[-3000:]}"


CASES = [("ConveyorTrack-v0", 0), ("ConveyorTrack-v0", 128)]


@pytest.mark.parametrize(("env_id", "num_envs"), CASES)
def test_interrupts_leave_an_environment_usable(env_id: str, num_envs: int) -> None:
    run(INTERRUPTS, env_id, num_envs)


@pytest.mark.parametrize(("env_id", "num_envs"), [("MinTorqueMove-v0", 0), ("ConveyorTrack-v0", 128)])
def test_threads_that_share_an_environment_are_refused(env_id: str, num_envs: int) -> None:
    run(THREADS, env_id, num_envs)


@pytest.mark.parametrize(
    ("env_id", "num_envs"),
    [("ConveyorTrack-v0", 128), ("ExcavatorPayload-v0", 2), ("MinTorqueMove-v0", 0), ("ObstacleDodge-v0", 0)],
)
def test_nothing_public_can_be_overwritten_to_harm(env_id: str, num_envs: int) -> None:
    run(OVERWRITTEN, env_id, num_envs)
