"""Uniform square images made of a dataset, for training translators."""

__all__: list[str] = []
