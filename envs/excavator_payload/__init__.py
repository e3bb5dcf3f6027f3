"""ExcavatorPayload-v0: its environment, kernels, physics, reference motions, experts and card."""
