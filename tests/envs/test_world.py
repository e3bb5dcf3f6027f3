import numpy as np
import pymunk
import pytest
from numba import njit

from envs.physics import chipmunk
from envs.physics.rigid_bodies import whole_multiple

set_position, set_velocity = chipmunk.body_set_position, chipmunk.body_set_velocity
get_position, get_velocity = chipmunk.body_get_position, chipmunk.body_get_velocity


@njit
def write_and_read(body: int) -> tuple[tuple[float, float], tuple[float, float]]:
    set_position(body, 1.5, -2.5)
    set_velocity(body, 0.25, 8.0)
    return get_position(body), get_velocity(body)


def test_vectors_cross_the_bridge_unharmed() -> None:
    body = pymunk.Body(1.0, 1.0)
    position, velocity = write_and_read(chipmunk.address(body._body))
    assert position == tuple(body.position) == (1.5, -2.5)
    assert velocity == tuple(body.velocity) == (0.25, 8.0)


def test_a_missing_c_function_is_named() -> None:
    with pytest.raises(ImportError, match=r"no cpSpaceFly.*pymunk>=7"):
        chipmunk._bind("cpSpaceFly", chipmunk._nothing)


@pytest.mark.parametrize(("period", "step", "count"), [(0.02, 0.002, 10), (0.02, 0.02, 1), (0.01, 0.0005, 20)])
def test_substeps(period: float, step: float, count: int) -> None:
    assert whole_multiple("control_period", period, "physics_step", step) == count


@pytest.mark.parametrize(("period", "step"), [(0.02, 0.003), (0.02, 0.05), (0.02, 0.0), (0.02, -0.001)])
def test_a_period_that_is_no_multiple_is_refused(period: float, step: float) -> None:
    with pytest.raises(ValueError, match=rf"control_period {period} s is no multiple of physics_step {step} s; choose"):
        whole_multiple("control_period", period, "physics_step", step)


def test_spaces_are_freed_quietly_at_exit() -> None:
    import subprocess
    import sys

    code = "import envs, gymnasium as gym; env = gym.make('ConveyorTrack-v0'); env.reset(seed=0)"
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr == ""


def test_angles_are_read_half_a_step_ahead() -> None:
    # A free link keeps its speed, so its angle must be exactly linear in time.
    from planners import Arm, JointLimits
    from tools.physics_fidelity import CONTROL_PERIOD, SimulatedArm

    wheel = Arm("wheel", (1.0,), (1.0,), JointLimits(torque=(1.0,)), coms=(0.0,), inertias=(1.0,))
    simulated = SimulatedArm(wheel, 1e-3)
    simulated.place(np.array([0.2]), np.array([3.0]))
    for k in range(1, 51):
        q, qd = simulated.advance(np.zeros(1))
        assert q[0] == pytest.approx(0.2 + 3.0 * k * CONTROL_PERIOD, abs=1e-12)
        assert qd[0] == pytest.approx(3.0, abs=1e-12)
