"""Gymnasium environments for planar robot arms: importing this registers their ids.

Without the import, name the module in the id: ``gym.make("envs:ConveyorTrack-v0")``.
"""

import gymnasium as gym

_MODULES = {"ConveyorTrack-v0": "envs.conveyor_track:ConveyorTrack"}

for _env_id, _name in _MODULES.items():
    if _env_id not in gym.registry:
        gym.register(_env_id, entry_point=f"{_name}Env", vector_entry_point=f"{_name}VectorEnv")
