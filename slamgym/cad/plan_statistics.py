"""Figures that describe floor plans, to compare generated ones with real ones."""

from dataclasses import dataclass

import numpy as np
import shapely
from shapely import Polygon

from slamgym.cad.floorplan import Door, FloorPlan
from slamgym.cad.polygons import oriented_rings
from slamgym.core.types import BoolArray, FloatArray

SIMPLIFY = 0.03
"""Tolerance [m] that removes the 1 cm staircases in which HouseExpo stores curved and oblique walls."""
JAMB_LENGTH = (0.05, 0.35)
"""Length of the end face of a wall [m]."""
OPENING_WIDTH = (0.5, 2.5)
"""Width of a door or a wider opening [m]."""


@dataclass(frozen=True)
class PlanStatistics:
    """The measured figures of one plan."""

    rooms: int
    area: float
    """Free space [m2]."""
    long_side: float
    """Longer side of the bounding box [m]."""
    aspect: float
    """Longer side over shorter side."""
    fill: float
    """Free space over bounding box."""
    vertices: int
    """Corners after simplification by 3 cm."""
    holes: int
    """Walls, pillars and islands that can be walked round."""
    opening_widths: tuple[float, ...]
    """Clear widths of the doors and wider openings that :func:`find_openings` finds [m]."""

    @property
    def openings(self) -> int:
        """Number of openings."""
        return len(self.opening_widths)


def measure_plan(plan: FloorPlan) -> PlanStatistics:
    """Measure one plan."""
    min_x, min_y, max_x, max_y = plan.bounds
    short, long = sorted((max_x - min_x, max_y - min_y))
    simple = plan.free_space.simplify(SIMPLIFY)
    assert isinstance(simple, Polygon)
    corners = [len(ring.coords) - 1 for ring in (simple.exterior, *simple.interiors)]
    return PlanStatistics(
        rooms=len(plan.rooms),
        area=plan.area,
        long_side=long,
        aspect=long / short,
        fill=plan.area / (short * long),
        vertices=sum(corners),
        holes=len(simple.interiors),
        opening_widths=tuple(door.width for door in find_openings(simple)),
    )


def find_openings(free_space: Polygon) -> list[Door]:
    """The openings in a plan's walls, from geometry alone.

    An opening has on one side at least the end of a wall: a short edge between two corners that point into
    the free space. Its other side is whatever wall faces that edge, 0.5 to 2.5 m away.
    """
    start, along, is_wall_end = _edges(free_space)
    length = np.hypot(*along.T)
    ends = np.flatnonzero(is_wall_end & (length > JAMB_LENGTH[0]) & (length < JAMB_LENGTH[1]))
    doors: list[Door] = []
    found: set[int] = set()
    for edge in ends:
        if edge in found:
            continue
        normal = np.array([-along[edge, 1], along[edge, 0]]) / length[edge]
        jamb = start[edge] + 0.5 * along[edge]
        distance, facing = _first_hit(jamb, normal, start, along)
        if OPENING_WIDTH[0] <= distance <= OPENING_WIDTH[1]:
            x, y = (jamb + distance * normal).tolist()
            doors.append(Door((float(jamb[0]), float(jamb[1])), (x, y)))
            found.add(facing)
    return doors


def _edges(free_space: Polygon) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Edges, free space on their left: start (S, 2), vector (S, 2), and whether both ends are reflex."""
    starts, vectors, ends = [], [], []
    for ring in oriented_rings(free_space):
        points = shapely.get_coordinates(ring)[:-1]
        vector = np.roll(points, -1, axis=0) - points
        unit = vector / np.hypot(*vector.T)[:, None]
        before = np.roll(unit, 1, axis=0)
        # The sine of the turn at the edge's start; below 0 the corner points into the free space.
        turn = before[:, 0] * unit[:, 1] - before[:, 1] * unit[:, 0]
        starts.append(points)
        vectors.append(vector)
        ends.append((turn < -0.5) & (np.roll(turn, -1) < -0.5))
    return np.vstack(starts), np.vstack(vectors), np.concatenate(ends)


def _first_hit(
    origin: FloatArray, direction: FloatArray, start: FloatArray, along: FloatArray
) -> tuple[float, int]:
    """Distance [m] and index of the first edge that a ray meets; infinite if there is none."""
    offset = start - origin
    with np.errstate(divide="ignore", invalid="ignore"):
        cross = direction[0] * along[:, 1] - direction[1] * along[:, 0]
        distance = (offset[:, 0] * along[:, 1] - offset[:, 1] * along[:, 0]) / cross
        share = (offset[:, 0] * direction[1] - offset[:, 1] * direction[0]) / cross
        ahead = (distance > 1e-3) & (share >= 0.0) & (share <= 1.0)
    distance = np.where(ahead, distance, np.inf)
    nearest = int(np.argmin(distance))
    return float(distance[nearest]), nearest
