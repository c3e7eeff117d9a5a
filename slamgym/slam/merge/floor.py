"""A finished map as others are laid on it: its surfaces with their sides, what is free, and views to search for.

Maps of graphs and bare pictures become the same record, so that one search and one judgement serve both.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from slamgym.core.types import FREE, OCCUPIED, FloatArray, OccupancyGrid
from slamgym.slam.branch_and_bound import face_of
from slamgym.slam.graph.closures import FEW_SURFACES
from slamgym.slam.graph.map_graph import MapGraph
from slamgym.slam.graph.mapper import MATCH_RANGE
from slamgym.slam.graph.relative import seen_from
from slamgym.slam.graph.submaps import (
    SUBMAP_CELL,
    OrientedPoints,
    Submap,
    known_surfaces,
    oriented_scan,
)
from slamgym.slam.merge.days import are_clear, draw_days

VIEW_REACH = 8.0
"""Surfaces further than this from the middle of a view aren't part of it [m]."""
VIEW_SUBMAPS = 1
"""A view holds a submap and so many before and behind it: 6 m of driving."""
VIEW_SPACING = 2.0
"""Views lie so far apart [m]: nearer ones show the same."""
PICTURE_TILE = 6.0
"""Side of the tiles of a picture, each with a view: those of smaller ones show the same [m]."""
SMOOTHED = 2.0
"""Standard deviation over which a picture is smoothed to find its walls' normals [cells]."""
LEAST_SLOPE = 0.4
"""A smoothed picture that is flatter than this shows no normal."""


class View(NamedTuple):
    """What was seen near a place."""

    pose: FloatArray  # (3,) of the place on its map
    surfaces: OrientedPoints  # in the frame of the place


@dataclass(frozen=True)
class Floor:
    """A finished map."""

    grid: OccupancyGrid
    surfaces: OrientedPoints
    """Of the whole map, in its frame, at most one a cell and side."""
    views: tuple[View, ...]
    """What is sought of it on other maps."""


def graph_floor(graph: MapGraph, submaps: list[Submap], has_views: bool = True) -> Floor:
    """The floor of a graph with its submaps: what stands there now."""
    grid = draw_days(graph)
    frames = graph.poses[graph.submaps[:, 0]]
    placed = [submap.lines().placed(frame) for submap, frame in zip(submaps, frames, strict=True)]
    if len(graph.drives) > 1:
        placed = [_standing(surfaces, grid) for surfaces in placed]
    views: list[View] = []
    for number, frame in enumerate(frames if has_views else []):
        if any(np.hypot(*(view.pose - frame)[:2]) < VIEW_SPACING for view in views):
            continue
        first = max(0, number - VIEW_SUBMAPS)
        around = _thinned(OrientedPoints.joined(placed[first : number + VIEW_SUBMAPS + 1]))
        views.append(_view(frame, around))
    return _floor(grid, _thinned(OrientedPoints.joined(placed)), views)


def _standing(surfaces: OrientedPoints, grid: OccupancyGrid) -> OrientedPoints:
    """Surfaces without those on free floor: what they show is gone, or has been seen only once."""
    rows, cols = grid.frame.to_cell(*surfaces.points.T)
    inside = (
        (rows >= 0) & (rows < grid.frame.height_px) & (cols >= 0) & (cols < grid.frame.width_px)
    )
    stands = np.ones(len(rows), dtype=bool)
    clear = are_clear(grid.cells, grid.frame.resolution)
    stands[inside] = ~clear[rows[inside], cols[inside]]
    return surfaces.at(stands)


def picture_floor(grid: OccupancyGrid) -> Floor:
    """The floor of a bare map."""
    surfaces = _thinned(picture_surfaces(grid))
    rows, cols = np.nonzero(grid.cells == FREE)
    x, y = grid.frame.to_point(rows, cols)
    tiles = np.floor(np.column_stack([x, y]) / PICTURE_TILE)
    views = []
    for tile in np.unique(tiles, axis=0):
        is_inside = (tiles == tile).all(axis=1)
        middle = np.array([x[is_inside].mean(), y[is_inside].mean(), 0.0])
        views.append(_view(middle, surfaces))
    return _floor(grid, surfaces, views)


def _floor(grid: OccupancyGrid, surfaces: OrientedPoints, views: list[View]) -> Floor:
    rich = [view for view in views if len(view.surfaces.points) >= FEW_SURFACES]
    return Floor(grid, surfaces, tuple(rich))


def _thinned(surfaces: OrientedPoints) -> OrientedPoints:
    """One piece a cell and direction of its side."""
    points, sides = surfaces
    faces = [face_of(x, y) for x, y in sides[:, :2].tolist()]
    keys = np.column_stack([np.floor(points / SUBMAP_CELL), faces])
    _, kept = np.unique(keys, axis=0, return_index=True)
    return surfaces.at(kept)


def _view(pose: FloatArray, surfaces: OrientedPoints) -> View:
    """What of some surfaces lies near a pose (3,)."""
    away = np.hypot(*(surfaces.points - pose[:2]).T)
    near = surfaces.at(away < VIEW_REACH)
    return View(pose, near.placed(seen_from(pose, np.zeros(3))))


def picture_surfaces(grid: OccupancyGrid) -> OrientedPoints:
    """Occupied cells next to free ones, once for each side that is free, and the walls' normals to that side."""
    import cv2

    points, sides = known_surfaces(grid)
    cells = grid.cells[::-1]
    free = (cells == FREE).astype(np.float32)
    occupied = (cells == OCCUPIED).astype(np.float32)
    smooth = cv2.GaussianBlur(free - occupied, (0, 0), SMOOTHED)
    frame = grid.frame
    places = np.floor((points - (frame.origin_x, frame.origin_y)) / frame.resolution)
    cols, rows = places.astype(np.int64).T
    slopes = [cv2.Sobel(smooth, cv2.CV_32F, *along)[rows, cols] for along in ((1, 0), (0, 1))]
    normals = np.column_stack(slopes).astype(np.float64)
    steepness = np.hypot(normals[:, 0], normals[:, 1])
    # A thin wall with floor on both sides has no slope: its sides are those of its cells.
    is_clear = (normals * sides[:, :2]).sum(axis=1) > 0.5 * np.maximum(steepness, LEAST_SLOPE)
    sides[is_clear, :2] = normals[is_clear] / steepness[is_clear, None]
    return OrientedPoints(points, sides)


def draw_submaps(graph: MapGraph) -> list[Submap]:
    """The submaps of a graph, from its scans."""
    submaps = []
    for drive in graph.drives:
        nodes = drive.nodes
        beams = drive.beams
        reach = min(drive.config.max_usable_range, MATCH_RANGE) + 3.0
        for first, end in graph.submaps[drive.owns(graph.submaps[:, 0])].tolist():
            submap = Submap(first, reach)
            for node in range(first, end):
                pose = seen_from(graph.poses[first], graph.poses[node])
                ranges = drive.ranges[node - nodes.start]
                submap.add(pose, oriented_scan(ranges, beams, MATCH_RANGE))
            submap.close()
            submaps.append(submap)
    return submaps
