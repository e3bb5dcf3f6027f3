"""DPCT: dynamic programming for conveyor tracking."""
