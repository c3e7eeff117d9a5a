"""Generative models between SLAM maps and CAD maps."""

__all__: list[str] = []
