"""Maps that come together: where one lies on another, whether that is sure, and one graph of all drives."""

__all__: list[str] = []
