"""Explorers on the same plans, starts and noise: trials, figures, tables, plots, videos."""

__all__: list[str] = []
