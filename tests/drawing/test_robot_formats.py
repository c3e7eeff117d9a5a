"""What a drawing gives to a robot keeps it on the floor, leads from room to room, and is a world to drive in."""

import dataclasses
import itertools
import json
import xml.etree.ElementTree as ET

import cv2
import numpy as np
import pytest
import shapely
from drawing.painted import FLAT, painted
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from slamgym.cad import open_plans
from slamgym.cad.floorplan import FloorPlan
from slamgym.core.types import FREE, OCCUPIED
from slamgym.drawing import make_drawing, write_drawing
from slamgym.drawing.formats.route_graph import ROUTE_RADIUS, drivable
from slamgym.drawing.settings import ROBOT_FORMATS
from slamgym.interop import read_ros_map

HOME = "home_000001"


def drawing_of(floor, name, turn_deg=0.0):
    grid, _, model = painted(floor, turn_deg=turn_deg)
    return make_drawing(grid, name, model)


@pytest.fixture(scope="module", params=["flat", HOME])
def drawing(request):
    if request.param == "flat":
        return drawing_of(FLAT, "flat", turn_deg=5.0)
    return drawing_of(open_plans("bundled").load(HOME).free_space, HOME)


@pytest.fixture
def files(drawing, tmp_path):
    return {path.name: path for path in write_drawing(drawing, tmp_path / "flat", ROBOT_FORMATS)}


def test_the_mask_lets_a_robot_on_the_floor_that_was_seen_and_nowhere_else(drawing, files):
    mask = read_ros_map(files["flat.keepout.yaml"])
    assert mask.frame == pytest.approx(drawing.grid.frame)
    assert set(np.unique(mask.cells)) == {OCCUPIED, FREE}
    y, x = np.indices(mask.cells.shape)
    points = shapely.points(*mask.frame.to_point(y, x))
    allowed = mask.cells == FREE
    assert shapely.covers(drawing.floor.buffer(1e-6), points[allowed]).all()
    assert allowed.sum() * mask.frame.resolution**2 == pytest.approx(drawing.area, rel=0.03)


def test_the_mask_keeps_off_floor_that_nobody_saw(tmp_path):
    drawing = drawing_of(FLAT, "flat")
    unseen = shapely.box(5.0, 1.0, 6.0, 2.0)
    drawing = dataclasses.replace(drawing, inferred_floor=(unseen,))
    (path,) = write_drawing(drawing, tmp_path / "flat", ["keepout.yaml"])
    mask = read_ros_map(path)
    row, col = mask.frame.to_cell(np.array([5.5, 4.5]), np.array([1.5, 1.5]))
    assert mask.cells[row, col].tolist() == [OCCUPIED, FREE]


def route(path):
    """Places, ways by their numbers, and lengths of shortest ways between all places."""
    features = json.loads(path.read_text())["features"]
    numbers = [feature["properties"]["id"] for feature in features]
    assert len(set(numbers)) == len(numbers)
    nodes = [one for one in features if one["geometry"]["type"] == "Point"]
    edges = [one for one in features if one["geometry"]["type"] == "MultiLineString"]
    assert [node["properties"]["id"] for node in nodes] == list(range(len(nodes)))
    points = np.array([node["geometry"]["coordinates"] for node in nodes])
    ways = np.array([(e["properties"]["startid"], e["properties"]["endid"]) for e in edges])
    costs = np.array([edge["properties"]["cost"] for edge in edges])
    graph = coo_array((costs, (ways[:, 0], ways[:, 1])), shape=(len(nodes), len(nodes)))
    rooms = [one for one in nodes if "metadata" in one["properties"]]
    return points, ways, dijkstra(graph.tocsr()), len(rooms)


def grid_lengths(drawing, points):
    """Shortest ways between places over the map's cells, 8 neighbours each, as wide as the robot."""
    frame = drawing.grid.frame
    free = drawing.grid.cells == FREE
    distance = cv2.distanceTransform(free.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    numbers = np.arange(free.size).reshape(free.shape)
    can_stand = distance * frame.resolution >= ROUTE_RADIUS
    height, width = free.shape
    starts, ends, steps = [], [], []
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here = (slice(0, height - down), slice(max(0, -right), width - max(0, right)))
        there = (slice(down, height), slice(max(0, right), width - max(0, -right)))
        both = can_stand[here] & can_stand[there]
        starts.append(numbers[here][both])
        ends.append(numbers[there][both])
        steps.append(np.full(both.sum(), np.hypot(down, right) * frame.resolution))
    table = (np.concatenate(steps), (np.concatenate(starts), np.concatenate(ends)))
    graph = coo_array(table, shape=(free.size, free.size)).tocsr()
    cells = numbers[frame.to_cell(*points.T)]
    return dijkstra(graph, directed=False, indices=cells)[:, cells]


def test_ways_join_all_rooms_that_the_map_joins_and_none_is_a_tenth_longer(drawing, files):
    points, _, lengths, num_rooms = route(files["flat.route.geojson"])
    assert num_rooms == len(drawing.rooms) >= 2
    expected = grid_lengths(drawing, points[:num_rooms])
    for first, second in itertools.combinations(range(num_rooms), 2):
        if np.isfinite(expected[first, second]):
            assert lengths[first, second] <= 1.1 * expected[first, second]
            assert lengths[second, first] == pytest.approx(lengths[first, second])


def test_every_way_is_wide_enough_for_the_robot(drawing, files):
    points, ways, _, _ = route(files["flat.route.geojson"])
    lines = shapely.linestrings(points[ways])
    assert shapely.covers(drivable(drawing).buffer(0.01), lines).all()


def bodies(path, model):
    """The bodies of a world's model: as drawn, and as what robots run into."""
    (found,) = ET.parse(path).getroot().iterfind(f"world/model[@name='{model}']")
    for kind in ("visual", "collision"):
        yield [
            shapely.Polygon([tuple(map(float, point.text.split())) for point in line.iter("point")])
            for part in found.iter(kind)
            for line in part.iter("polyline")
        ]


def test_the_world_of_gazebo_has_the_walls_of_the_drawing_and_its_doors_are_open(drawing, files):
    seen, touched = bodies(files["flat.sdf"], "walls")
    assert all(one.is_valid and one.is_simple for one in seen)
    assert [one.wkt for one in seen] == [one.wkt for one in touched]
    walls = shapely.union_all(seen)
    assert walls.intersection(drawing.floor).area < 0.01
    for door in drawing.doors:
        assert not walls.intersects(door.line.interpolate(0.5, normalized=True).buffer(0.2))
    # What is closed in by the walls is the floor: a robot that starts there can't get out.
    (enclosed,) = [
        part
        for part in shapely.get_parts(walls.envelope.buffer(1.0).difference(walls))
        if part.covers(drawing.rooms[0].polygon.representative_point())
    ]
    plan = FloorPlan("world", enclosed)
    drawn = plan.free_space
    assert drawn.intersection(drawing.floor).area / drawn.union(drawing.floor).area > 0.99


def test_in_the_world_of_gazebo_stands_what_the_map_shows_and_what_hid_the_floor(tmp_path):
    drawing = drawing_of(FLAT, "flat")
    table = shapely.box(0.5, 0.5, 2.0, 2.0).difference(shapely.box(1.0, 1.0, 1.2, 1.2))
    leg, bed = shapely.box(1.0, 4.0, 1.05, 4.05), shapely.box(5.0, 1.0, 6.0, 2.0)
    # Outlines are remembered by the drawing that they belong to.
    drawing = dataclasses.replace(drawing, inferred_floor=(table, bed))
    drawing.__dict__["echoes"] = [leg, *drawing.echoes]
    (path,) = write_drawing(drawing, tmp_path / "flat", ["sdf"])
    seen, touched = bodies(path, "things")
    assert [one.wkt for one in seen] == [one.wkt for one in touched]
    standing = shapely.union_all(seen)
    hidden = shapely.union_all([leg, table, bed])
    assert hidden.difference(standing).area < 1e-3
    assert standing.difference(hidden.union(drawing.floor.boundary.buffer(0.1))).area < 1e-3
