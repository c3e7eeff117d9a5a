"""``slamgym cad``: maps and drawings."""

__all__: list[str] = []
