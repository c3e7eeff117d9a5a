"""``slamgym reproduce``: the experiments of Daher et al. from floor plans to a report, by one command."""

__all__: list[str] = []
