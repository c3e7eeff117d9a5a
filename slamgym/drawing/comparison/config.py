"""The settings of a comparison."""

from typing import Annotated

from slamgym.core.config import Positive, PositiveShare, Settings, Share, Within


class ComparisonConfig(Settings, section="comparison"):
    """What counts as a change; chosen on half of the plans of ``benchmarks/plan_comparison/plan_comparison.py``."""

    scale: bool = False
    """Whether the map's scale is fitted, too (within 10 %); without it, a scale other than 1 is a doubt."""
    moved: Positive = 0.06
    """A wall that is farther from its place than this, after the map's own distortion, has moved [m]."""
    sure: Positive = 2.5
    """It must also be farther than so many standard errors."""
    search: Annotated[float, Within(gt=0.1, le=1.5)] = 0.75
    """Walls are looked for up to this far from their place [m]."""
    seen: PositiveShare = 0.3
    """A face of a wall of which less is seen is not judged."""
    shortest_face: Positive = 0.5
    """Shorter faces are measured, but none of their changes is reported [m]."""
    opening: Positive = 0.5
    """Gaps in a wall from this length on are openings [m]."""
    door_moved: Positive = 0.2
    """A door that is farther along its wall than this has moved [m]."""
    door_width: Positive = 0.15
    """A door is wider or narrower if its width differs by more than this [m]."""
    extra_wall: Positive = 0.9
    """Straight structures that the plan doesn't have count as walls from this length on [m]."""
    extra_thickness: Positive = 0.35
    """Structures that are thicker than this, or seen from one side alone, are taken for furniture [m]."""
    long_wall: Positive = 3.5
    """Structures from this length on are walls even when they are seen from one side alone [m]."""
    room_seen: Share = 0.3
    """A room of which the robot has seen less is not yet explored."""
