"""Floor plans in, explorations and map pairs out: recipes, the queue of explorations, their records."""

__all__: list[str] = []
