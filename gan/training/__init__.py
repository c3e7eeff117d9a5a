"""Training a translator: data stream, losses, schedule, validation, checkpoints."""
