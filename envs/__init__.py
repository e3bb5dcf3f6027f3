"""Gymnasium environments for planar robot arms: importing this registers their ids.

Without the import, name the module in the id: ``gym.make("envs:ConveyorTrack-v0")``.
`register` adds a task of your own.
"""

from typing import TYPE_CHECKING, Any

from envs.card import env_ids, register, task_card

if TYPE_CHECKING:
    from envs.experts import make_expert

__all__ = ["env_ids", "make_expert", "register", "task_card"]

for _folder, _name in {
    "conveyor_track": "ConveyorTrack",
    "min_torque_move": "MinTorqueMove",
    "obstacle_dodge": "ObstacleDodge",
    "excavator_payload": "ExcavatorPayload",
}.items():
    register(f"{_name}-v0", f"envs.{_folder}.env:{_name}", f"envs.{_folder}.card:CARD")


def __dir__() -> list[str]:
    return [*globals(), *__all__]


def __getattr__(name: str) -> Any:
    # Loaded when asked for: registering ids must not cost the import of every planner.
    if name == "make_expert":
        from envs.experts import make_expert

        return make_expert
    if name == "__version__":
        from importlib import metadata

        return metadata.version("planarm")
    raise AttributeError(f"module 'envs' has no attribute {name!r}")
