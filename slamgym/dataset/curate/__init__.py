"""Which pairs are fit for use: completeness, cleaning, review by people, splits."""

__all__: list[str] = []
