"""What has become of the plan's doors: open as planned, moved along their wall, of another width, or blocked."""

from collections.abc import Iterator

import numpy as np
import shapely
from scipy.spatial import KDTree

from slamgym.cad.floorplan import Door, FloorPlan
from slamgym.core.types import FREE, OCCUPIED, FloatArray, IntArray
from slamgym.drawing.comparison.faces import MapEvidence
from slamgym.drawing.comparison.records import Change, Line
from slamgym.drawing.comparison.walls import Faces

BEYOND = 1.3
"""The wall is looked at this far beyond both jambs [m]."""
STEP = 0.025
DEPTH = 0.1
"""A door is open where the map is free this far to both sides of the wall's middle [m]."""
NARROWEST = 0.45
"""A gap that is narrower is no door [m]."""
NEAREST_FACES = 40
MOVED, OTHER_WIDTH = 0.2, 0.15
"""A door has moved, or is wider or narrower, if it differs by more [m]."""


def door_changes(plan: FloorPlan, faces: Faces, evidence: MapEvidence) -> Iterator[Change]:
    """The doors that are not as planned."""
    tree = KDTree(faces.plan.points)
    for number, door in enumerate(plan.doors, start=1):
        line: Line = (*door.start, *door.end)
        unit = np.array([line[2] - line[0], line[3] - line[1]]) / max(door.width, 1e-6)
        shift = _distortion_at(faces, tree, 0.5 * (np.array(line[:2]) + np.array(line[2:])))
        states = _states(door, unit, evidence, shift)
        along = -BEYOND + STEP * (np.arange(len(states), dtype=np.float64) + 0.5)
        # Beyond the ends of the wall lie other rooms.
        places = np.array(door.start) + along[:, None] * unit
        is_floor = shapely.contains_xy(plan.free_space, places[:, 0], places[:, 1])
        states[is_floor & ((along < -STEP) | (along > door.width + STEP))] = 0
        inside = (along > 0.1) & (along < door.width - 0.1)
        if (states[inside] == 0).mean() > 0.5:
            continue
        gap = _best_gap(states, along, door.width)
        name = f"door {number}, {door.width:.2f} m"
        if gap is None:
            if (states[inside] < 0).mean() > 0.6:
                yield Change("door_blocked", name, line, door.width)
            continue
        if gap[0] <= along[0] or gap[1] >= along[-1]:
            continue  # the wall itself is gone there, which is another change
        offset = 0.5 * (gap[0] + gap[1]) - 0.5 * door.width
        if abs(offset) > MOVED and min(abs(gap[0]), abs(gap[1] - door.width)) > 0.5 * MOVED:
            yield Change("door_moved", name, line, door.width, offset, 2 * STEP, offset)
        elif abs(gap[1] - gap[0] - door.width) > OTHER_WIDTH:
            wider = gap[1] - gap[0] - door.width
            yield Change("door_width", name, line, door.width, wider, 2 * STEP, wider)


def _distortion_at(faces: Faces, tree: KDTree, place: FloatArray) -> FloatArray:
    """The map's shift at a place, from the distortions along the normals of the faces around, (2,) [m]."""
    _, index = tree.query(place, k=min(NEAREST_FACES, len(faces.plan.points)))
    normals = faces.plan.point_normals[index]
    # A little prior, where all faces look the same way.
    left = normals.T @ normals + 0.1 * np.eye(2)
    found: FloatArray = np.linalg.solve(left, normals.T @ faces.expected[index])
    return found


def _states(door: Door, unit: FloatArray, evidence: MapEvidence, shift: FloatArray) -> IntArray:
    """Along the wall's middle line: 1 open, -1 closed, 0 unknown."""
    normal = np.array([-unit[1], unit[0]])
    along = np.arange(-BEYOND + 0.5 * STEP, door.width + BEYOND, STEP)
    depths = np.arange(-DEPTH, DEPTH + 1e-9, 0.025)
    places = np.array(door.start) + shift + along[:, None] * unit
    cells = evidence.values(places[:, None] + depths[:, None] * normal)
    occupied, free = (cells == OCCUPIED).any(axis=1), (cells == FREE).mean(axis=1)
    return np.where(occupied, -1, np.where(free > 0.8, 1, 0))


def _best_gap(states: IntArray, along: FloatArray, width: float) -> tuple[float, float] | None:
    """The gap that overlaps the door most, or else is nearest to it: its ends along the wall [m]."""
    gap = np.concatenate([[False], states == 1, [False]])
    starts, stops = np.flatnonzero(~gap[:-1] & gap[1:]), np.flatnonzero(gap[:-1] & ~gap[1:]) - 1
    runs = [
        (float(along[a] - 0.5 * STEP), float(along[b] + 0.5 * STEP))
        for a, b in zip(starts, stops, strict=True)
    ]
    runs = [run for run in runs if run[1] - run[0] >= NARROWEST]
    return max(runs, key=lambda run: min(run[1], width) - max(run[0], 0.0), default=None)
