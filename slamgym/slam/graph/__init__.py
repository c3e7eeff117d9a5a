"""Graph SLAM: scans aligned with submaps, loop closures, least squares, and doubt about the result."""

__all__: list[str] = []
