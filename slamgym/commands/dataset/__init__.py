"""``slamgym dataset <command>``: what can be done with explorations that exist."""

__all__: list[str] = []
