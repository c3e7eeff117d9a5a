"""``slamgym reproduce``: the experiments of Daher et al. from floor plans to a report, by one command."""
