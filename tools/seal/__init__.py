"""The sealed list of the leaderboard, made anew for each release; see `tools.seal.__main__`."""
