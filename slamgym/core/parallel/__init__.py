"""Independent tasks on many processes: of this machine, or of a Ray cluster."""

__all__: list[str] = []
