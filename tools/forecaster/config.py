"""How the forecaster is trained."""

from __future__ import annotations

from pydantic import Field

from envs.settings import Settings


class ForecastConfig(Settings):
    """How the forecaster is trained.

    Attributes:
        episodes: whose discs are watched.
        samples: instants of each at which a forecast is made.
        hidden: width of the two hidden layers.
        epochs: passes over all samples.
        batch_size: samples of a gradient step.
        learning_rate: at the start; it falls to 0, linearly.
    """

    episodes: int = Field(90_000, ge=12)
    samples: int = Field(16, ge=1)
    hidden: int = Field(64, ge=1)
    epochs: int = Field(10, ge=1)
    batch_size: int = Field(512, ge=2)
    learning_rate: float = Field(2e-3, gt=0.0)
