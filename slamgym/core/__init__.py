"""Basics of every part: records, SE(2), errors, settings, files, progress, parallel engines, intervals."""

__all__: list[str] = []
