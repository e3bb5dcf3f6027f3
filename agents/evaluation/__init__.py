"""Evaluation: paired episodes, their summary, comparisons, the leaderboard, and the benchmark with its bounds."""
