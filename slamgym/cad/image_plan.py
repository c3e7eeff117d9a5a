"""Floor plans from pictures: ROS maps and plain black/white images.

The outline follows the borders of the cells exactly, so a raster of the plan at the picture's own resolution
gives the picture's free cells back. By default it is then smoothed by less than a cell, which turns the
staircases of oblique walls into straight lines and doesn't change straight walls.
"""

from pathlib import Path

import numpy as np
import shapely
from shapely import Polygon

from slamgym.cad.floorplan import FloorPlan
from slamgym.cad.plan_formats import PlanOptions
from slamgym.cad.plan_index import PlanIndex
from slamgym.cad.polygons import connected_part, polygon_parts
from slamgym.core.errors import InputFileError, PlanError, as_plan_error
from slamgym.core.files import read_bytes
from slamgym.core.geometry import transform_points
from slamgym.core.limits import PLAN_PARTS, RUNS, VERTICES
from slamgym.core.pictures import decode_picture, grey_picture
from slamgym.core.types import FREE, BoolArray, GridFrame
from slamgym.interop.ros_map import read_turned_map

PLAN_SMOOTHING = 0.75
"""Default tolerance of smoothing [cells]: just above the 0.71 cells by which a diagonal staircase strays."""
SALT_NOISE_AREA = 0.5
"""Free patches smaller than this [m2] are dropped."""
MAX_GREY = 220
"""The lightest grey that isn't white; ROS maps mark the unknown as 205."""
MIN_ENCLOSED_SHARE = 0.3
"""A building's enclosed floor makes up at least this share of the box round its walls."""
OUTER_DOOR = 1.5
"""The outside doesn't reach in through gaps narrower than this [m]."""
MIN_PATCH_SHARE = 0.8
"""The largest patch must make up this share of the free space, else the space counts as disjoint."""


@as_plan_error()
def read_ros_plan(path: Path | str, smoothing: float = PLAN_SMOOTHING) -> FloorPlan:
    """Read the free space of a ROS map, which may have a yaw; unknown cells count as walls.

    Args:
        path: The map's yaml file; the image lies next to it.
        smoothing: Tolerance [cells]; 0 keeps the borders of the cells.

    Raises:
        PlanError: If the map can't be read, has no free space, or several disjoint parts of it.
    """
    path = Path(path)
    grid, placement = read_turned_map(path)
    plan = trace_plan(grid.cells == FREE, grid.frame, path.stem, str(path), smoothing)
    if placement.theta == 0.0:
        return plan
    placed = shapely.transform(plan.free_space, lambda points: transform_points(placement, points))
    return FloorPlan(plan.id, placed, source=plan.source)


@as_plan_error()
def read_image_plan(
    path: Path | str, resolution: float, smoothing: float = PLAN_SMOOTHING
) -> FloorPlan:
    """Read a black/white picture: white pixels are floor, black and grey ones are not.

    White round the building is distinguished from floor by touching the picture's edge; outer doors of up to 1.5 m
    that stand open are taken for shut, so that the robot stays inside. If little within the walls is left even so,
    because the floor itself reaches the edge, all white counts as floor.

    Args:
        path: The picture.
        resolution: Size of a pixel [m].
        smoothing: Tolerance [pixels]; 0 keeps the borders of the pixels.

    Raises:
        PlanError: If the file is no picture, or has no floor or several disjoint parts of it.
    """
    path = Path(path)
    if not resolution > 0.0:
        raise PlanError(path, f"the resolution must be above 0 m per pixel, not {resolution}")
    grey, _ = grey_picture(decode_picture(path, read_bytes(path), upright=True))
    inside = _without_outside(grey > MAX_GREY, resolution)
    height, width = inside.shape
    frame = GridFrame(resolution, 0.0, 0.0, height, width)
    return trace_plan(inside, frame, path.stem, str(path), smoothing)


def open_ros_plan(path: Path, options: PlanOptions) -> PlanIndex:
    """The plan of a ROS map."""
    del options  # nothing about the format is open
    return PlanIndex({path.stem: (path,)}, read_ros_plan)


def open_picture(path: Path, options: PlanOptions) -> PlanIndex:
    """The plan of a picture.

    Raises:
        InputFileError: If its metres per pixel are not given.
    """
    if options.scale is None:
        raise InputFileError(
            path, f"a picture needs its metres per pixel; write {path}@0.05, for example"
        )
    return PlanIndex({path.stem: (path, options.scale)}, read_image_plan)


def trace_plan(
    inside: BoolArray, frame: GridFrame, plan_id: str, source: str, smoothing: float = 0.0
) -> FloorPlan:
    """Make a plan of the largest connected patch of cells; rooms and doors stay unknown.

    Convention: ``inside`` is ``[row, col]`` with row 0 at the top; the plan has the coordinates of ``frame``.

    Args:
        inside: True where there is floor, the shape of ``frame``.
        frame: Where the cells lie.
        plan_id: Name of the plan.
        source: Named in errors.
        smoothing: Tolerance [cells].

    Raises:
        PlanError: If there is no floor, or the largest patch is less than 80 % of it.
    """
    patches = [patch for patch in _patches(inside, frame, source) if patch.area >= SALT_NOISE_AREA]
    if not patches:
        raise PlanError(
            source,
            f"has no free patch of {SALT_NOISE_AREA} m2 or more; check colours and resolution",
        )
    largest = connected_part(shapely.GeometryCollection(patches), MIN_PATCH_SHARE, source)
    outline = largest.simplify(smoothing * frame.resolution) if smoothing > 0.0 else largest
    if not isinstance(outline, Polygon) or not outline.is_valid:
        outline = largest
    PLAN_PARTS.check(source, len(outline.interiors), PlanError)
    VERTICES.check(source, len(shapely.get_coordinates(outline)), PlanError)
    return FloorPlan(plan_id, outline, source=source)


def _patches(inside: BoolArray, frame: GridFrame, source: str) -> list[Polygon]:
    """The connected patches of cells as polygons; cells that only share a corner are apart."""
    padded = np.pad(inside, ((0, 0), (1, 1))).astype(np.int8)
    # Shape (height, width + 1): +1 where a run of free cells begins, -1 after it.
    change = np.diff(padded, axis=1)
    row, first = np.nonzero(change == 1)
    _, stop = np.nonzero(change == -1)
    RUNS.check(source, len(first), PlanError)
    # Rows count from the top; whole numbers keep the union exact, metres come after it.
    top = frame.height_px - row
    runs = shapely.box(first, top - 1, stop, top)
    origin = np.array([frame.origin_x, frame.origin_y])
    union = shapely.union_all(runs).simplify(0.0)
    metres = shapely.transform(union, lambda points: points * frame.resolution + origin)
    return polygon_parts(metres)


def _without_outside(white: BoolArray, resolution: float) -> BoolArray:
    """Remove white patches that touch the picture's edge, unless they hold the floor."""
    rows = np.flatnonzero(~white.all(axis=1))
    cols = np.flatnonzero(~white.all(axis=0))
    if len(rows) == 0:
        return white
    height = rows[-1] - rows[0] + 1
    width = cols[-1] - cols[0] + 1
    enough = MIN_ENCLOSED_SHARE * (height * width)
    enclosed = white & ~_connected_to_edge(white)
    if enclosed.sum() < enough:
        enclosed = white & ~_reached_from_edge(white, 0.5 * OUTER_DOOR / resolution)
    return enclosed if enclosed.sum() >= enough else white


def _connected_to_edge(white: BoolArray) -> BoolArray:
    """The white patches (4-connected) that touch the picture's edge."""
    import cv2

    _, labels = cv2.connectedComponents(white.astype(np.uint8), connectivity=4)
    edges = (labels[0], labels[-1], labels[:, 0], labels[:, -1])
    at_edge = np.unique(np.concatenate(edges))
    return white & np.isin(labels, at_edge)


def _reached_from_edge(white: BoolArray, radius: float) -> BoolArray:
    """Pixels that a disc of this radius [px] covers as it rolls in from beyond the picture's edge."""
    import cv2

    pad = int(2.0 * radius) + 2
    around = np.pad(white, pad, constant_values=True).astype(np.uint8)
    to_wall = cv2.distanceTransform(around, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    centres = _connected_to_edge(to_wall > radius)
    others = (~centres).astype(np.uint8)
    to_centre = cv2.distanceTransform(others, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return to_centre[pad:-pad, pad:-pad] <= radius
