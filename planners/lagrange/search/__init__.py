"""Searches for the motion of least torque, and for the least time of a motion."""
