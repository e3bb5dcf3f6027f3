"""Trains the forecaster of ObstacleDodge-v0."""
