"""DPCT with torque as its index: least torque along a straight line in joint space, in a given time."""
