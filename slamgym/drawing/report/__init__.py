"""Reports of drawings and comparisons as HTML pages, and a gallery of them."""

__all__: list[str] = []
