"""The batch of a task, put together from what the task declares, its settings and its robot."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numba import types

from envs.batch.batch import Batch
from envs.batch.records import Fields, make_records
from envs.physics.actuation import actuation_constants, actuation_env_fields, arm_kernels
from envs.physics.closed_form import closed_form_constants
from envs.physics.episode import EPISODE_FIELDS
from envs.physics.rigid_bodies import arm_constants, arm_fields, model_record
from planners.compiled.calls import Kernel


def assemble(
    task: Any,
    num_envs: int,
    env_fields: Fields,
    constants: Mapping[str, Any],
    table_shape: tuple[int, ...],
    kernels: Mapping[str, Kernel | None],
) -> Batch:
    """The batch of a task that has its settings, arm and uncertainty; the other arguments are those of `Task`.

    Raises:
        ValueError: for a task that is to observe noise and has no kernel for it.
    """
    config, arm, uncertainty = task.config, task.arm, task.uncertainty
    common: Fields = [*arm_fields(arm.n_joints), *actuation_env_fields(arm.n_joints), *EPISODE_FIELDS]
    own: Fields = [
        ("action", "f8", (task.action_size(config, arm),)),
        ("seen", task.layout.record),
        ("observation", "f4", (task.layout.size,)),
        ("reward_terms", "f8", (len(task.reward_terms),)),
        *env_fields,
    ]
    mode, loaded = task.actuation_mode(config), arm.with_payload(uncertainty.ends["payload"][0])
    shared = {
        "control_period": config.control_period,
        **arm_constants(loaded, config.control_period, config.physics_step),
        **actuation_constants(arm, mode),
        **closed_form_constants(loaded, config.physics),
    }
    used = {**arm_kernels(mode, config.physics), **uncertainty.kernels(), **kernels}
    model = model_record(
        {
            **shared,
            "scales": task.layout.scales,
            "bounds": task.layout.bounds,
            "horizon_steps": task.horizon_steps,
            **config.numbers(),
            **dict.fromkeys(used, 0),
            **constants,
        }
    )
    batch = Batch(task.kernels, loaded, num_envs, [*common, *own], model, table_shape)
    # Kernels of every task know the first fields only, and are the same for tasks with as many joints.
    first, whole = (make_records(0, common).dtype, model_record(shared).dtype), (batch.records.dtype, model.dtype)
    for name, kernel in used.items():
        if kernel is not None and name == "physics_kernel":
            model[name] = kernel.address(batch.records, model, *(types.intp,) * 3)
        elif kernel is not None:
            model[name] = kernel.address(*(whole if name in kernels else first))
    if uncertainty.noisy and not task.measures:
        model["measure_kernel"] = _measuring(task).address(batch.records, model, types.intp)
    return batch


def _measuring(task: Any) -> Kernel:
    """The kernel that observes with noise; a ValueError if the task has none."""
    if not hasattr(task.kernels, "MEASURE"):
        raise ValueError(
            f"{task.env_id} observes without noise: encoder_noise, velocity_noise and camera_noise must be 0, or its "
            "module of kernels needs a kernel MEASURE (docs/environments/uncertainty.md)"
        )
    kernel: Kernel = task.kernels.MEASURE
    return kernel
