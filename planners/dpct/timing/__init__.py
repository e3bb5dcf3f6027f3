"""DPCT among moving discs: a straight line to a fixed target, timed so that no disc is touched."""
