"""Names and sizes that several steps of a drawing share, and the settings of a comparison. It imports nothing heavy."""

import math

from slamgym.core.config import Positive, Settings

ROBOT_FORMATS = ("keepout.yaml", "route.geojson", "sdf")
"""What a drawing gives to a robot: a mask for Nav2's keep-out filter, a graph for its route server, a Gazebo world."""
DRAWING_FORMATS = ("dxf", "svg", "ifc", "geojson", "json", "png", "html", "yaml", *ROBOT_FORMATS)
DEFAULT_MODEL = "slam2cad"
DRAWN_DOORS = (0.55, 1.6)
"""Narrowest and widest gap in a wall that is a door [m]. Doors of homes end at 1.35 m and open passages begin at
1.85 m (:data:`slamgym.metrics.rooms.WIDEST_DOORWAY`)."""
SMALLEST_ROOM = 1.0
"""Smaller floors and parts of floors aren't drawn by themselves [m2]."""
USUAL_CELL = 0.05
"""Cell of usual maps [m]: what is nearer or smaller, such a map can't tell."""
SAME_DIRECTION = math.radians(8.0)
"""Lines whose directions differ by no more run alike [rad]."""
MARGIN = 1.0
"""What is shown or looked at goes so far beyond what is known, drawn or meant [m]."""
NARROWEST_DRAWN = 0.2
"""Floor that is narrower isn't drawn, such as a slit between two walls, so no boundary is shorter [m]."""
THICKEST_WALL = 0.5
"""Two faces farther apart aren't those of one wall [m]."""
WALL_HEIGHT = 2.5
"""Height of walls and rooms, usual in homes [m]; a map has no heights."""
OUTER_WALL = 0.2
"""In a robot's map and world all is wall so far round the floor [m]: the walls between two rooms are whole, those
to the outside so thick."""
OUTER_THICKNESS = 0.1
"""Walls of which only one face was seen are drawn so thick: no wall between rooms is usually thinner [m]."""
SAME_PLACE = 0.02
"""Places nearer to each other are one, by less than half a cell [m]: cuts end so far within walls, what is as near to a
face is on it, and shorter pieces are no walls (they would be 6 % more)."""
THINNEST_WALL = 0.01
"""Thinner walls aren't drawn [m]; those of one cell come out little thicker. With 0.02 one of 28 doors in furnished
homes is lost, with 0.04 room F1 of 57 real maps falls by 0.014."""
MAJORITY = 0.5
"""What holds of so much of a thing is said of all of it: a wall, a door or a room is in the layer SEEN, a room is the
former one or has a segment's name, a wall is where most of its points say."""


class ComparisonConfig(Settings, section="comparison"):
    """Rules for a change; chosen on half of the plans of ``benchmarks/plan_comparison/plan_comparison.py``."""

    moved: Positive = 0.06
    """A wall that is farther from its place than this, after the map's own distortion, has moved [m]."""
    sure: Positive = 2.5
    """It must also be farther than so many standard errors."""
