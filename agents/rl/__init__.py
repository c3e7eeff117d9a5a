"""Learning to explore: environments, policies, imitation, training, reward shaping."""

__all__: list[str] = []
