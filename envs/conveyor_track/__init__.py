"""ConveyorTrack-v0: its environment, kernels, start distribution, experts and card."""
