"""Planned motions: sampled trajectories, their interpolation, and the measurement of their limits and clearance."""

from planners.trajectory.trajectory import NoMotion, Trajectory, sampled_trajectory

__all__ = ["NoMotion", "Trajectory", "sampled_trajectory"]
