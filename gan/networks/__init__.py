"""The networks: generators, discriminators and their layers."""

__all__: list[str] = []
