"""Estimates from the map about the floor that is still unseen: features of each frontier, and of the whole.

Frontiers are searched as the last attempts of an exploration would find them: short ones too, and those behind doors
that the map draws too narrow. Rooms that the map cuts off count as closed area.
"""

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slamgym.core.types import BoolArray, ByteArray, FloatArray, Int32Array, IntArray, OccupancyGrid, Pose2D
from slamgym.planning.costmap import Costmap, CostmapConfig, crop_known, free_body, make_costmap
from slamgym.planning.frontier_candidates import COARSENING
from slamgym.planning.frontier_feature_kernels import (
    UnknownRegion,
    classify_costs,
    coarse_cells,
    explore_unknown_region,
)
from slamgym.planning.frontiers import Point, closed_space, expected_gain, frontier_cells, reachable_space

FRONTIER_FEATURES = (
    "size", "extent", "gain", "near", "far", "outside", "enclosed", "free_border", "wall_border",
    "others", "opening", "offered", "in_reach",
)  # fmt: skip
"""Features of each frontier; ``opening`` is the widest distance from walls in it."""
WHOLE_FEATURES = ("known_area", "closed_area", "attempts", "frontiers", "left_out")
"""Features of the whole map."""

_SHORTEST = 0.15
"""Shorter frontiers are noise [m]."""
_NARROW = 0.6
"""Share of the radius with which the last doors are tried."""
_NEAR, _FAR = 1.5, 4.0
"""The unknown behind a frontier is flooded up to these distances [m]."""
_JOINED_PX = 5
"""Frontiers with gaps below so many cells are one: rays that fan out through a door leave a chequered edge."""
_MOST = 24
"""So many frontiers are measured, the longest; the others are only counted."""


@dataclass(frozen=True)
class Remains:
    """A map's frontiers in numbers."""

    frontiers: FloatArray  # (N, len(FRONTIER_FEATURES))
    whole: FloatArray  # (len(WHOLE_FEATURES),)
    known_area: float  # floor that the robot can get to and has seen [m2]
    points: tuple[FloatArray, ...] = ()  # centres of each frontier's cells, shape (M, 2) [m]
    costmap: Costmap | None = None  # on which it was measured


def measure_remains(
    grid: OccupancyGrid,
    pose: Pose2D,
    radius: float,
    range_max: float,
    offered: Sequence[Point] = (),
    attempts: int = 0,
    before: Remains | None = None,
) -> Remains | None:
    """Measure what a map doesn't show yet; None where the robot finds no place for itself on it.

    Args:
        grid: The map.
        pose: The believed pose.
        radius: The robot's [m].
        range_max: The scanner's [m].
        offered: A point of each frontier that the exploration still means to visit [m].
        attempts: How many relaxed footprints the exploration has tried at its end.
        before: What an older version of the map didn't show; saves time on large maps.
    """
    known = free_body(crop_known(grid, pose), pose, radius)
    costmap = make_costmap(known, _narrow_config(_NARROW * radius), before.costmap if before else None)
    space = reachable_space(costmap, pose)
    if space is None:
        return None
    frontiers = _joined(frontier_cells(costmap.costs, space.mask), costmap.frame.resolution)
    measured = frontiers[:_MOST]
    points = tuple(costmap.frame.to_points(cells[:, 0], cells[:, 1]) for cells in measured)
    rows = _measure(costmap, measured, points, radius, range_max, offered)
    known_area, closed_area = (
        float(np.count_nonzero(mask)) * costmap.frame.resolution**2
        for mask in (space.mask, closed_space(costmap, space))
    )
    left_out = len(frontiers) - len(measured)
    whole = [known_area / 100.0, closed_area / 5.0, min(attempts, 2), len(frontiers) / 8.0, left_out / 8.0]
    return Remains(rows, np.array(whole), known_area, points, costmap)


@functools.cache
def _narrow_config(radius: float) -> CostmapConfig:
    return CostmapConfig(inscribed_radius=radius, inflation_radius=radius)


def _joined(edge: BoolArray, resolution: float) -> list[IntArray]:
    """Cells (N, 2) of frontiers, those close together as one, the longest first."""
    import cv2

    grown = cv2.dilate(edge.view(np.uint8), np.ones((_JOINED_PX, _JOINED_PX), np.uint8))
    _, labels = cv2.connectedComponents(grown, connectivity=8)
    cells = np.column_stack(np.nonzero(edge))
    owner = labels[cells[:, 0], cells[:, 1]]
    order = np.argsort(owner, kind="stable")
    ends = np.flatnonzero(np.diff(owner[order])) + 1
    groups = np.split(cells[order], ends)
    least = _SHORTEST / resolution
    return sorted((group for group in groups if len(group) >= least), key=len, reverse=True)


def unknown_regions(
    costmap: Costmap, frontiers: Sequence[IntArray | Int32Array]
) -> tuple[ByteArray, float, list[UnknownRegion]]:
    """Measure the unknown behind frontiers, given by their cells, each of shape (N, 2).

    Returns:
        A coarse map (:func:`classify_costs`), the size of its cells [m], and the region behind each frontier.
    """
    classes, cell = classify_costs(costmap.costs, COARSENING), costmap.frame.resolution * COARSENING
    coarse = [coarse_cells(cells.astype(np.int32), COARSENING, classes.shape) for cells in frontiers]
    labels = np.full(classes.shape, -1, np.int16)
    for index, cells in enumerate(coarse):
        labels[cells[:, 0], cells[:, 1]] = index
    # The margin is what a costmap keeps about the known part.
    steps, margin, count = (round(_NEAR / cell), round(_FAR / cell)), round(0.5 / cell), len(coarse)
    regions = [
        explore_unknown_region(classes, labels, index, cells, steps, margin, count)
        for index, cells in enumerate(coarse)
    ]
    return classes, cell, regions


def _measure(
    costmap: Costmap,
    frontiers: Sequence[IntArray],
    points: Sequence[FloatArray],
    radius: float,
    range_max: float,
    offered: Sequence[Point],
) -> FloatArray:
    """Features of frontiers, given by their cells and these cells' centres, shape (N, len(FRONTIER_FEATURES))."""
    resolution = costmap.frame.resolution
    _, cell, regions = unknown_regions(costmap, frontiers)
    wanted = np.array(offered, dtype=np.float64).reshape(-1, 2)
    rows = np.zeros((len(frontiers), len(FRONTIER_FEATURES)))
    for index, (cells, places, region) in enumerate(zip(frontiers, points, regions, strict=True)):
        width, height = (places.max(axis=0) - places.min(axis=0)).tolist()
        middle_x, middle_y = places[np.argmin(((places - places.mean(axis=0)) ** 2).sum(axis=1))].tolist()
        apart = np.abs(places[:, None] - wanted).max(axis=2).min(initial=np.inf)
        opening = float(costmap.distance[cells[:, 0], cells[:, 1]].max()) * resolution
        rows[index] = (
            len(cells) * resolution / 3.0,
            math.hypot(width, height) / 3.0,
            expected_gain(costmap, (middle_x, middle_y), range_max) / 15.0,
            region.near * cell**2 / 5.0,
            region.far * cell**2 / 20.0,
            region.outside,
            region.is_enclosed,
            region.free * cell / 5.0,
            region.occupied * cell / 10.0,
            region.frontiers / 4.0,
            min(opening, 1.5),
            float(apart <= 0.5),
            float(opening >= radius),
        )
    return rows
