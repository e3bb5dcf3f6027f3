"""ObstacleDodge-v0: its environment, kernels, start distribution, obstacle paths, experts and card."""
