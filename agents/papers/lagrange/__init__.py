"""The minimal-torque paper's results regenerated."""
