"""Comparison of a dataset's maps with those of robots: sets of maps, tests, and the page of results."""

__all__: list[str] = []
