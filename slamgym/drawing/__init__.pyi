from .comparison import PlanComparison, compare_with_plan
from .drawing import Dimension, Drawing, DrawnDoor, DrawnRoom, DrawnWall
from .edits import read_corrections
from .floor import FloorModel, load_floor_model
from .formats.write import drawing_map, write_drawing
from .settings import ComparisonConfig
from .vectorise import make_drawing

__all__ = [
    "ComparisonConfig",
    "Dimension",
    "Drawing",
    "DrawnDoor",
    "DrawnRoom",
    "DrawnWall",
    "FloorModel",
    "PlanComparison",
    "compare_with_plan",
    "drawing_map",
    "load_floor_model",
    "make_drawing",
    "read_corrections",
    "write_drawing",
]
