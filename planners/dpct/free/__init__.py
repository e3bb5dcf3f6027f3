"""DPCT off the line: every joint's own way to a moving target, within the same limits."""
