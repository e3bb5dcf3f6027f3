"""Difficulty levels of MinTorqueMove-v0."""

from __future__ import annotations

from envs.card import Level

LEVELS = {
    "slow": Level("3 s for every move", options={"duration": 3.0}, every_arm=False),
    "short": Level("moves as short as 90 % of the torque limits let the quintic be", options={"torque_share": 0.9}),
    "vertical": Level("in a vertical plane", {"gravity": 9.81}),
    "vertical_slow": Level(
        "in a vertical plane, 3 s for every move", {"gravity": 9.81}, {"duration": 3.0}, every_arm=False
    ),
    "payload": Level("unknown payload of up to 0.2 kg", {"payload": (0.0, 0.2)}),
    "model_error": Level("each link up to 10 % lighter or heavier", {"mass_error": (-0.1, 0.1)}),
    "friction": Level(
        "joints with up to 0.02 N m s/rad and 0.02 N m of friction",
        {"viscous_friction": (0.0, 0.02), "coulomb_friction": (0.0, 0.02)},
    ),
    "latency": Level("torques come up to 5 ms late", {"latency": (0.0, 0.005)}),
    "noise": Level("encoder noise of 0.05 mrad", {"encoder_noise": 5e-5}),
    "uncertain": Level(
        "masses, friction, latency and noise together",
        {
            "mass_error": (-0.1, 0.1),
            "viscous_friction": (0.0, 0.02),
            "coulomb_friction": (0.0, 0.02),
            "latency": (0.0, 0.005),
            "encoder_noise": 5e-5,
        },
    ),
}
