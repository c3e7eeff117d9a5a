"""Localisation on a finished map: global search, Kalman filters that track several places, and doubt that is said."""

__all__: list[str] = []
