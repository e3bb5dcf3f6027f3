"""Dodging by forecasts: a network learns the ways that a disc may go, and the field of `planners.apf` weighs them.

:mod:`~agents.forecasting.track` remembers a disc, :mod:`~agents.forecasting.features` says what is to be seen of it,
:mod:`~agents.forecasting.futures` turns that into paths with probabilities, and :mod:`~agents.forecasting.policy` acts.
:mod:`~agents.forecasting.training` fits the network to paths drawn as the environment draws them.
"""

from agents.forecasting.forecaster import Forecaster, load_forecaster, save_forecaster
from agents.forecasting.policy import ForecastingDodger

__all__ = ["Forecaster", "ForecastingDodger", "load_forecaster", "save_forecaster"]
