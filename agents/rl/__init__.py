"""Learning to explore: environments, policies, training, reward shaping."""

__all__: list[str] = []
