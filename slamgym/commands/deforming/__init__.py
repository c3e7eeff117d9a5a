"""The parts of ``slamgym deform``: hypotheses of each method, the dataset that they are written to, the figures."""

__all__: list[str] = []
