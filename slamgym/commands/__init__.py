"""The command line: one module for each command, under one table; nothing imports it."""

__all__: list[str] = []
