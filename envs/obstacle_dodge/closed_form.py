"""The arm among the discs in closed form: a control period of a pack of environments (`envs.physics.closed_form`)."""

from __future__ import annotations

from typing import Any

import numpy as np

from envs.obstacle_dodge.kernels import measure_clearance, move_discs, sample_at
from envs.physics.closed_form import integrate, read_chain, read_links, vector, write_joints
from envs.physics.episode import table_of
from envs.physics.packs import WIDTH, least, memory, most, reals, sine_and_cosine, spread, square_root
from planners.compiled.calls import Kernel, inlined

_pack = memory(1)


def _move_among_discs(batch: Any, model: Any, first: int, last: int, steps: int) -> None:
    """Advance environments ``first`` to ``last - 1``, at most `WIDTH`, and measure the clearance after every step."""
    shared = model[0]
    inertia, along, none, tau, phi, w = vector(), vector(), vector(), vector(), vector(), vector()
    across_x, across_y, gap, closest = vector(), vector(), _pack(), _pack()
    read_links(batch, first, last, phi, w, tau)
    read_chain(shared, inertia, along, none)
    closest[0] = spread(np.inf)
    for step in range(steps):
        integrate(shared, 1, (inertia, along, none), (tau, none), none, phi, w)
        for i in range(shared.lengths.shape[0]):
            sine, cosine = sine_and_cosine(phi[i])
            across_x[i], across_y[i] = shared.lengths[i] * cosine, shared.lengths[i] * sine
        gap[0] = spread(np.inf)
        if shared.second_arm_kernel == 0:
            for disc in range(shared.num_obstacles):
                gap[0] = least(gap[0], _clearance(batch, shared, first, last, step, disc, across_x, across_y))
        else:  # one by one: the second arm is measured as with Pymunk
            write_joints(batch, first, last, phi, w)
            for index in range(first, last):
                env = batch[index]
                move_discs(env, shared, env.step * shared.control_period + (step + 1) * shared.physics_step)
                reals(gap)[index - first] = measure_clearance(env, shared)
        closest[0] = least(closest[0], gap[0])
    write_joints(batch, first, last, phi, w)
    for index in range(first, last):
        env = batch[index]
        move_discs(env, shared, env.step * shared.control_period + steps * shared.physics_step)
        env.clearance, env.closest = reals(gap)[index - first], reals(closest)[index - first]


@inlined
def _clearance(batch: Any, shared: Any, first: int, last: int, step: int, disc: int, links_x: Any, links_y: Any) -> Any:
    """Distance between the surfaces of the arm and a disc after a step, m, as `planners.robot.clearance` has it.

    ``links_x`` and ``links_y`` lead from a link's inner end to its outer one, packs of ``(n,)``, m.
    """
    x, y, radius = _pack(), _pack(), _pack()
    for place in range(WIDTH):
        env = batch[min(first + place, last - 1)]
        left, share = sample_at(shared, env.step * shared.control_period + (step + 1) * shared.physics_step)
        path = table_of(env, (shared.path_samples, env.radii.shape[0], 2))
        before, after = path[left, disc], path[left + 1, disc]
        reals(x)[place] = before[0] + share * (after[0] - before[0])
        reals(y)[place] = before[1] + share * (after[1] - before[1])
        reals(radius)[place] = env.radii[disc]
    from_x, from_y, nearest = x[0] - shared.base[0], y[0] - shared.base[1], spread(np.inf)
    for i in range(shared.lengths.shape[0]):
        way = (from_x * links_x[i] + from_y * links_y[i]) / (shared.lengths[i] * shared.lengths[i])
        way = least(spread(1.0), most(spread(0.0), way))
        dx, dy = from_x - way * links_x[i], from_y - way * links_y[i]
        nearest = least(nearest, dx * dx + dy * dy)
        from_x, from_y = from_x - links_x[i], from_y - links_y[i]
    return square_root(nearest) - shared.link_radius - radius[0]


MOVE_AMONG_DISCS = Kernel(_move_among_discs, error_model="numpy")
