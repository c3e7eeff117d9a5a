"""Translators measured: scores, tables, realism, pictures."""
