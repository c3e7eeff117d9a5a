"""Localisation on a finished map: global search, particles that track several hypotheses, and doubt that is said."""

__all__: list[str] = []
