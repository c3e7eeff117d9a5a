"""Translators measured: scores, tables, realism, pictures."""

__all__: list[str] = []
