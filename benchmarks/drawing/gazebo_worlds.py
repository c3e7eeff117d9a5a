"""Does a laser see in a drawing's Gazebo world what the map shows?

    python benchmarks/drawing/gazebo_worlds.py slam_maps/giraff_real_homes

A scanner stands wherever a robot fits and looks 8 m far round itself. What it sees is compared with the free cells of
the map that was drawn, with and without what stands in the rooms (the model `things`): intersection over union, of all
cells and of those within the drawn walls. What lies beyond are rays through windows and floor that isn't drawn.
"""

import argparse
import math
import sys
from pathlib import Path

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from slamgym.cad.floorplan import ring_segments
from slamgym.cad.polygons import largest_part, polygon_parts
from slamgym.core.intervals import mean_interval
from slamgym.core.progress import say
from slamgym.core.types import FREE, BoolArray, GridFrame
from slamgym.drawing import make_drawing
from slamgym.drawing.evidence import filled, filled_patch
from slamgym.drawing.formats.gazebo import standing_bodies
from slamgym.drawing.settings import OUTER_WALL
from slamgym.interop import read_ros_map
from slamgym.sim.raycast import cast_rays

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

MODULES = ("slamgym/drawing",)
"""What is measured."""
RANGE = 8.0
"""Of the scanner [m]."""
BEAMS = 360
STEP = 0.5
"""Between two places of the scanner [m]."""
ROBOT = 0.16
"""Radius of the robot [m]."""
COLUMNS = ("map", "things", "IoU", "[95 %]", "IoU within the walls", "[95 %] of that")
TITLE = "What a laser sees in drawings' Gazebo worlds, against the free cells of their maps"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("maps", type=Path, help="folder of ROS maps")
    overlaps: dict[str, list[tuple[float, float]]] = {"no": [], "yes": []}
    rows: list[tuple[str, ...]] = []
    for path in sorted(parser.parse_args().maps.glob("*.yaml")):
        grid = read_ros_map(path)
        drawing = make_drawing(grid, path.stem)
        free = grid.cells == FREE
        within = filled(drawing.floor.buffer(OUTER_WALL, join_style="mitre"), grid.frame)
        things = shapely.union_all(standing_bodies(drawing))
        for name, space in (("no", drawing.floor), ("yes", drawing.floor.difference(things))):
            seen = seen_cells(space, grid.frame)
            found = (overlap(seen, free), overlap(seen & within, free & within))
            overlaps[name].append(found)
            rows.append((path.stem, name, f"{found[0]:.3f}", "", f"{found[1]:.3f}", ""))
            say(" ".join(rows[-1]))
    for name, pairs in overlaps.items():
        shown: list[str] = []
        for values in np.transpose(pairs):
            interval = mean_interval(values)
            shown += [f"{interval.value:.3f}", f"{interval.low:.3f} to {interval.high:.3f}"]
        rows.append(("all", name, *shown))
    print_and_save("drawing/gazebo_worlds", TITLE, rows, COLUMNS, MODULES)


def seen_cells(space: BaseGeometry, frame: GridFrame) -> BoolArray:
    """Cells (H, W) of a frame that the scanner sees in a space, from all places of its largest part."""
    parts = polygon_parts(space)
    rings = [ring for part in parts for ring in (part.exterior, *part.interiors)]
    walls = np.ascontiguousarray(ring_segments(rings), np.float64)
    drivable = largest_part(space.buffer(-ROBOT))
    left, low, right, high = drivable.bounds
    places = np.meshgrid(np.arange(left, right, STEP), np.arange(low, high, STEP))
    is_drivable = shapely.contains_xy(drivable, *places)
    bearings = np.arange(BEAMS) * 2.0 * math.pi / BEAMS
    ranges = np.empty(BEAMS)
    seen = np.zeros((frame.height_px, frame.width_px), np.bool_)
    for x, y in zip(places[0][is_drivable], places[1][is_drivable], strict=True):
        cast_rays(x, y, 0.0, 0.0, 2.0 * math.pi / BEAMS, walls, RANGE, ranges)
        ends = np.minimum(ranges, RANGE)
        corners = np.stack([x + ends * np.cos(bearings), y + ends * np.sin(bearings)], axis=1)
        for part in polygon_parts(shapely.Polygon(corners).buffer(0.0)):
            patch = filled_patch(part, frame)
            seen[patch.place] |= patch.inside
    return seen


def overlap(first: BoolArray, second: BoolArray) -> float:
    """Intersection over union."""
    return float((first & second).sum() / (first | second).sum())


if __name__ == "__main__":
    main()
