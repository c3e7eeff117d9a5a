from .drawn_plan import DrawnPlan, DrawnWalls, floor_of_walls
from .dxf import read_dxf
from .geojson import read_geojson
from .ifc import read_ifc, storeys_of
from .source import DrawingSource

__all__ = [
    "DrawingSource",
    "DrawnPlan",
    "DrawnWalls",
    "floor_of_walls",
    "read_dxf",
    "read_geojson",
    "read_ifc",
    "storeys_of",
]
