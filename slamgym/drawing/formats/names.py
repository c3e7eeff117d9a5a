"""The formats of drawings by their names."""

from typing import Literal, get_args

DrawingFormat = Literal["dxf", "svg", "ifc", "geojson", "json", "png", "html", "yaml"]
DRAWING_FORMATS: tuple[str, ...] = get_args(DrawingFormat)
