"""``slamgym agents <command>``: train, evaluate and compare explorers."""

__all__: list[str] = []
