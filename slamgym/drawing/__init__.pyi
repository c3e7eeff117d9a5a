from .drawing import Dimension, Drawing, DrawnDoor, DrawnRoom, DrawnWall, DrawnWindow
from .floor import CleanedFloor, FloorModel, load_floor_model
from .formats.write import write_drawing
from .settings import DrawingConfig
from .vectorise import make_drawing

__all__ = [
    "CleanedFloor",
    "Dimension",
    "Drawing",
    "DrawingConfig",
    "DrawnDoor",
    "DrawnRoom",
    "DrawnWall",
    "DrawnWindow",
    "FloorModel",
    "make_drawing",
    "load_floor_model",
    "write_drawing",
]
