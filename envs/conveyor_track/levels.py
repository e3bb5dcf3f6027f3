"""Difficulty levels of ConveyorTrack-v0."""

from __future__ import annotations

from envs.card import Level

_NOISE = {"encoder_noise": 5e-5, "camera_noise": 2e-4, "position_tolerance": 3e-3, "velocity_tolerance": 2e-2}

LEVELS = {
    "fast": Level(
        "belt at 0.3 m/s",
        options={"belt_speed": 0.3, "line_height": 1.7, "hand_x": -0.8, "offset": (0.16, 0.2), "elbow": "-"},
        every_arm=False,
    ),
    "accelerating": Level("belt that accelerates by 0.05 m/s^2", {"belt_acceleration": 0.05}),
    "near": Level("belt at 1.3 m from the base", options={"line_height": 1.3}, every_arm=False),
    "far": Level(
        "belt at 1.85 m from the base, close to the reach of 2 m", options={"line_height": 1.85}, every_arm=False
    ),
    "wide": Level(
        "belts of 0.05 to 0.3 m/s, 1.25 to 1.87 m from the base",
        options={"belt_speed": (0.05, 0.305), "line_height": (1.25, 1.87), "hand_x": (-0.95, -0.3)},
        every_arm=False,
    ),
    "beside": Level("hand starts up to 0.2 m beside the belt's line", options={"beside": (-0.2, 0.2)}, every_arm=False),
    "payload": Level("unknown payload of up to 0.3 kg", {"payload": (0.0, 0.3)}),
    "model_error": Level("each link up to 10 % lighter or heavier", {"mass_error": (-0.1, 0.1)}),
    "friction": Level(
        "joints with up to 0.05 N m s/rad and 0.01 N m of friction",
        {"viscous_friction": (0.0, 0.05), "coulomb_friction": (0.0, 0.01)},
    ),
    "latency": Level("torques come up to 20 ms late", {"latency": (0.0, 0.02)}),
    "noise": Level("encoder noise of 0.05 mrad, camera noise of 0.2 mm; tolerances 3 mm, 20 mm/s", _NOISE),
    "uncertain": Level(
        "masses, friction, latency and noise together",
        {
            "mass_error": (-0.1, 0.1),
            "viscous_friction": (0.0, 0.05),
            "coulomb_friction": (0.0, 0.01),
            "latency": (0.0, 0.02),
            **_NOISE,
        },
    ),
}
