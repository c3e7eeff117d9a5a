"""Explorers on the same plans, starts and noise: trials, figures, tables, plots."""

__all__: list[str] = []
