"""Graph-based SLAM: nodes, matching against local maps, loop closures, least squares."""

__all__: list[str] = []
