"""Pictures: of maps, plans and explorations, sheets of them, films, the window."""

__all__: list[str] = []
