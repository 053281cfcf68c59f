"""The benchmark: suites of episodes, entries that have played one, and the leaderboard of entries."""
