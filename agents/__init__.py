"""Explorers: classical rules and trained policies for the slamgym environments."""

__all__: list[str] = []
