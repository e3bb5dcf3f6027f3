"""Gymnasium environments for planar robot arms: importing this registers their ids.

Without the import, name the module in the id: ``gym.make("envs:ConveyorTrack-v0")``.
"""

from typing import TYPE_CHECKING, Any

import gymnasium as gym

if TYPE_CHECKING:
    from envs.experts import make_expert

__all__ = ["make_expert"]

_TASKS = {
    "ConveyorTrack-v0": "envs.conveyor_track.env:ConveyorTrack",
    "MinTorqueMove-v0": "envs.min_torque_move.env:MinTorqueMove",
    "ObstacleDodge-v0": "envs.obstacle_dodge.env:ObstacleDodge",
    "ExcavatorPayload-v0": "envs.excavator_payload.env:ExcavatorPayload",
}

for _env_id, _name in _TASKS.items():
    if _env_id not in gym.registry:
        gym.register(_env_id, entry_point=f"{_name}Env", vector_entry_point=f"{_name}VectorEnv")


def __getattr__(name: str) -> Any:
    # Loaded when asked for: registering ids must not cost the import of every planner.
    if name == "make_expert":
        from envs.experts import make_expert

        return make_expert
    raise AttributeError(f"module 'envs' has no attribute {name!r}")
