"""``slamgym cad``: maps and drawings."""
