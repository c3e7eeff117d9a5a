"""What a drawing is made by: sizes in metres, with the reasons."""

from typing import Annotated

from slamgym.core.config import Positive, Settings, Share, Within

_Size = Annotated[float, Within(ge=0.0, lt=10.0)]


class DrawingConfig(Settings, section="drawing"):
    """Sizes of what is drawn, joined and left out."""

    tolerance: Positive = 0.045
    """An outline strays from its straight lines by at most this, or by a cell where that is more [m]."""
    snap: _Size = 0.05
    """A line is turned to a main direction where that moves its ends by at most this [m]."""
    snap_drift: _Size = 0.1
    """The same for a line within a degree of a main direction: drift bends walls, architects seldom do [m]."""
    merge: _Size = 0.06
    """Steps in a wall of at most this are the map's, not the wall's [m]."""
    chamfer: _Size = 0.2
    """An oblique edge of at most this between two walls at right angles is a corner that was rounded [m]."""
    min_floor: _Size = 1.0
    """Separate floor smaller than this isn't drawn [m2]."""
    min_hole: _Size = 0.05
    """Things on the floor smaller than this aren't drawn [m2]."""
    door_width: tuple[
        Annotated[float, Within(gt=0.0, lt=10.0)], Annotated[float, Within(gt=0.0, lt=10.0)]
    ] = (
        0.55,
        1.6,
    )
    """Narrowest and widest gap in a wall that is a door [m]. Doors of homes end at 1.35 m and open passages begin at
    1.85 m (:class:`slamgym.metrics.RoomRule`)."""
    opening_width: Positive = 1.6
    """Widest gap between two jambs that is an opening and parts two rooms [m]; whether a double door hangs in it a map
    doesn't tell. No wider than a door, and rooms go on through it, as :class:`slamgym.metrics.RoomRule` has it."""
    max_thickness: Positive = 0.5
    """Two faces farther apart aren't those of one wall [m]."""
    outer_thickness: Positive = 0.1
    """Walls of which only one face was seen are drawn so thick [m]."""
    min_room: Positive = 1.0
    """Smaller parts of the floor aren't rooms of their own [m2]."""
    min_room_width: Positive = 0.7
    """Nor are narrower ones [m]."""
    evidence: Positive = 0.15
    """A piece of wall was seen if the map has an occupied cell within this [m]."""
    seen_share: Share = 0.5
    """A wall is in the layer SEEN if so much of its length was."""
    min_inferred: _Size = 0.05
    """Smaller patches of floor that was never observed aren't marked [m2]."""
    min_unexplored: _Size = 1.0
    """Smaller gaps inside of the building aren't marked as unexplored [m2]."""


DEFAULT_DRAWING = DrawingConfig()
DRAWING_FORMATS = ("dxf", "svg", "ifc", "geojson", "json", "png", "html", "yaml")
DEFAULT_MODEL = "slam2cad-metric+slam2cad"
"""The first keeps sizes; the second draws what the first takes for rays and the robot saw as wide free space."""


class ComparisonConfig(Settings, section="comparison"):
    """What counts as a change; chosen on half of the plans of ``benchmarks/plan_comparison/plan_comparison.py``."""

    scale: bool = False
    """Fit the map's scale, too (within 10 %); without it, a scale other than 1 is a doubt."""
    moved: Positive = 0.06
    """A wall that is farther from its place than this, after the map's own distortion, has moved [m]."""
    sure: Positive = 2.5
    """It must also be farther than so many standard errors."""
