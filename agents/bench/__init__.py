"""slamgym-bench: a frozen benchmark for explorers, its results and its leaderboard."""

__all__: list[str] = []
