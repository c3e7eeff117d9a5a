"""How a dataset's maps differ from those of robots: sets of maps, tests, the page that shows it all."""

__all__: list[str] = []
