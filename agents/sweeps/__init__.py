"""Sweeps: many training runs with different settings, side by side on Ray."""
