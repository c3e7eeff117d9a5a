from .comparison import ComparisonConfig, PlanComparison, compare_with_plan
from .drawing import Dimension, Drawing, DrawnDoor, DrawnRoom, DrawnWall, DrawnWindow
from .floor import CleanedFloor, FloorModel, load_floor_model
from .formats.ros_map import drawing_map
from .formats.write import write_drawing
from .settings import DrawingConfig
from .vectorise import make_drawing

__all__ = [
    "CleanedFloor",
    "ComparisonConfig",
    "Dimension",
    "Drawing",
    "DrawingConfig",
    "DrawnDoor",
    "DrawnRoom",
    "DrawnWall",
    "DrawnWindow",
    "FloorModel",
    "PlanComparison",
    "compare_with_plan",
    "drawing_map",
    "load_floor_model",
    "make_drawing",
    "write_drawing",
]
