"""Lagrange interpolation through two via-nodes, past moving discs."""
