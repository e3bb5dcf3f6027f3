"""Submissions to the leaderboard: folders with an agent and a card, scored and compared without running their code."""
