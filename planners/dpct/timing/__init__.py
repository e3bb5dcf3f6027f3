"""DPCT among moving discs: along a straight line to a fixed target, timed so that no disc is touched."""
