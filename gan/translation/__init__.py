"""Maps in, maps of the other kind out: trained and classical translators, tiling, derotation."""

__all__: list[str] = []
