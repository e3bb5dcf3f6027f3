"""Demonstrations as Minari datasets: recorded from any policy, read back for training."""
