"""Training a translator: data stream, losses, schedule, validation, checkpoints."""

__all__: list[str] = []
