"""Dodging by forecasts: a network learns the ways that a disc may go, and the field of `planners.apf` weighs them.

:mod:`~agents.policies.forecasting.track` remembers a disc, :mod:`~agents.policies.forecasting.features` says what is
to be seen of it, :mod:`~agents.policies.forecasting.futures` turns that into paths with probabilities, and
:mod:`~agents.policies.forecasting.policy` acts.
:mod:`~tools.forecaster.training` fits the network to paths drawn as the environment draws them.
"""

from agents.policies.forecasting.forecaster import Forecaster, load_forecaster, save_forecaster
from agents.policies.forecasting.policy import ForecastingDodger

__all__ = ["Forecaster", "ForecastingDodger", "load_forecaster", "save_forecaster"]
