from .drawing import Dimension, Drawing, DrawnDoor, DrawnRoom, DrawnWall, DrawnWindow
from .floor import CleanedFloor, FloorModel, load_floor_model
from .formats.write import write_drawing
from .settings import DrawingConfig
from .vectorise import draw_map

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
    "draw_map",
    "load_floor_model",
    "write_drawing",
]
