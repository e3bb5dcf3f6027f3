"""Difficulty levels of ExcavatorPayload-v0."""

from __future__ import annotations

from envs.card import Level

LEVELS = {
    "heavy": Level("payloads of 250 to 350 kg", {"lightest": 250.0}),
    "friction": Level("threefold friction of the joints", options={"friction_scale": 3.0}),
    "level_2": Level("drives that lag by 30 ms, payload picked up and dropped on the way", {"level": 2}),
    "model_error": Level("each link up to 10 % lighter or heavier", {"mass_error": (-0.1, 0.1)}),
    "latency": Level("torques come up to 20 ms late", {"latency": (0.0, 0.02)}),
    "noise": Level("threefold encoder noise", {"encoder_noise": 3e-4}),
    "uncertain": Level(
        "masses, latency and noise together",
        {"mass_error": (-0.1, 0.1), "latency": (0.0, 0.02), "encoder_noise": 3e-4},
    ),
}
