"""Pictures: sheets of maps and plans, overlays, films, the window."""

__all__: list[str] = []
