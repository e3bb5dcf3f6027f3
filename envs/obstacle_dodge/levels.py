"""Difficulty levels of ObstacleDodge-v0."""

from __future__ import annotations

from envs.card import Level

LEVELS = {
    "large": Level("disc with a radius of 0.2 m", options={"obstacle_radius": 0.2}, every_arm=False),
    "fast": Level("disc at 1.5 m/s", options={"obstacle_speed": 1.5}, every_arm=False),
    "very_fast": Level("disc at 2 m/s", options={"obstacle_speed": 2.0}, every_arm=False),
    "fast_large": Level(
        "disc with a radius of 0.2 m at 1.5 m/s",
        options={"obstacle_radius": 0.2, "obstacle_speed": 1.5},
        every_arm=False,
    ),
    "fast_very_large": Level(
        "disc with a radius of 0.25 m at 1.5 m/s",
        options={"obstacle_radius": 0.25, "obstacle_speed": 1.5},
        every_arm=False,
    ),
    "two_discs": Level("two discs", {"num_obstacles": 2}),
    "fast_two_discs": Level("two discs at 1.5 m/s", {"num_obstacles": 2}, {"obstacle_speed": 1.5}, every_arm=False),
    "three_discs": Level("three discs", {"num_obstacles": 3}),
    "four_discs": Level("four discs", {"num_obstacles": 4}),
    "second_arm": Level("a second arm beside the disc", {"second_arm": True}),
    "model_error": Level("each link up to 10 % lighter or heavier", {"mass_error": (-0.1, 0.1)}),
    "friction": Level(
        "joints with up to 0.05 N m s/rad and 0.05 N m of friction",
        {"viscous_friction": (0.0, 0.05), "coulomb_friction": (0.0, 0.05)},
    ),
    "latency": Level("torques come up to 40 ms late", {"latency": (0.0, 0.04)}),
    "noise": Level("encoder noise of 0.05 mrad, camera noise of 3 mm", {"encoder_noise": 5e-5, "camera_noise": 3e-3}),
    "uncertain": Level(
        "masses, friction, latency and noise together",
        {
            "mass_error": (-0.1, 0.1),
            "viscous_friction": (0.0, 0.05),
            "coulomb_friction": (0.0, 0.05),
            "latency": (0.0, 0.04),
            "encoder_noise": 5e-5,
            "camera_noise": 3e-3,
        },
    ),
}
