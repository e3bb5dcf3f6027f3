"""MinTorqueMove-v0: its environment, kernels, random moves, experts and card."""
