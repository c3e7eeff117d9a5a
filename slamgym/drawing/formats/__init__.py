"""Drawings as files: DXF, SVG, IFC, GeoJSON, HouseExpo's JSON, PNG."""

__all__: list[str] = []
