"""Evaluation: paired episodes, their summary, comparisons, bounds, and the leaderboard."""
