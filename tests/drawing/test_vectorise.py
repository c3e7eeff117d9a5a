"""Drawings of floors that are known have their corners, dimensions, doors and rooms."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from drawing.painted import FLAT, Painted, painted
from shapely import Polygon

from slamgym.core.errors import InputFileError, SlamgymError
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, GridFrame, OccupancyGrid
from slamgym.drawing import load_floor_model, make_drawing
from slamgym.drawing.confidence import confidences, wall_signs
from slamgym.drawing.contours import trace_outlines, trace_patches
from slamgym.drawing.evidence import Evidence
from slamgym.drawing.polygons import without_necks
from slamgym.drawing.walls import WallPiece


def num_corners(shape):
    return sum(
        len(ring.coords) - 1
        for part in shapely.get_parts(shape)
        for ring in (part.exterior, *part.interiors)
    )


@pytest.mark.parametrize("turn", [0.0, 17.0, -40.0])
def test_a_flat_has_its_true_corners_doors_and_rooms(turn):
    grid, floor, model = painted(FLAT, turn_deg=turn)
    drawing = make_drawing(grid, model=model)
    assert drawing.angle_deg == pytest.approx(turn, abs=0.3)
    assert num_corners(drawing.floor) == num_corners(floor)
    assert drawing.floor.hausdorff_distance(floor) < 0.02
    (door,) = drawing.doors
    assert door.width == pytest.approx(0.9, abs=0.03)
    assert door.depth == pytest.approx(0.1, abs=0.02)
    assert set(door.rooms) == {room.id for room in drawing.rooms}
    assert sorted(room.area for room in drawing.rooms) == pytest.approx([9.6, 17.0], abs=0.2)
    assert all(room.polygon.is_valid and room.layer == "SEEN" for room in drawing.rooms)
    assert drawing.doubts == ()


def test_widths_are_exact_and_on_the_dimension_lines():
    grid, _, model = painted(FLAT)
    drawing = make_drawing(grid, model=model)
    small = min(drawing.rooms, key=lambda room: room.area)
    lengths = [line.length for line in drawing.dimensions if line.of == small.id]
    assert sorted(lengths) == pytest.approx([3.0, 3.2], abs=0.02)
    overall = [line.length for line in drawing.dimensions if line.of == "building"]
    assert overall == pytest.approx([7.3, 5.0], abs=0.02)


def test_the_wall_between_two_rooms_has_its_thickness_and_its_door_on_both_sides():
    grid, _, model = painted(FLAT)
    drawing = make_drawing(grid, model=model)
    between = [wall for wall in drawing.walls if wall.thickness_known]
    assert [wall.thickness for wall in between] == pytest.approx([0.1, 0.1], abs=0.02)
    assert sorted(wall.length for wall in between) == pytest.approx([0.8, 1.3], abs=0.03)
    (door,) = drawing.doors
    assert {drawing.walls.index(wall) for wall in between} <= set(door.walls)


def test_walls_enclose_the_floor_without_gaps_at_corners():
    grid, floor, model = painted(FLAT)
    drawing = make_drawing(grid, model=model)
    bodies = shapely.union_all([wall.polygon for wall in drawing.walls])
    band = floor.buffer(0.05, join_style="mitre").difference(floor.buffer(0.01, join_style="mitre"))
    assert band.difference(bodies).area < 0.01 * band.area


@pytest.mark.parametrize(("width", "kind"), [(1.2, "door"), (2.0, "opening"), (2.4, "opening")])
def test_a_wide_opening_in_a_wall_separates_rooms_and_has_its_width(width, kind):
    rooms = shapely.union_all([shapely.box(0, 0, 4, 5), shapely.box(4.1, 0, 9, 5)])
    opening = shapely.box(4, 1, 4.1, 1 + width)
    grid, floor, _ = painted(rooms.union(opening))
    model = Painted(floor, opening)
    drawing = make_drawing(grid, model=model)
    (door,) = drawing.doors
    assert (door.kind, len(drawing.rooms)) == (kind, 2)
    assert door.width == pytest.approx(width, abs=0.02)


@pytest.mark.parametrize(
    "floor",
    [
        shapely.union_all(
            [shapely.box(0, 0, 8, 2), shapely.box(8, -3, 14, 5)]
        ),  # a corridor into a hall
        shapely.box(0, 0, 12, 2.4).difference(shapely.box(6, 0, 6.3, 0.4)),  # a pilaster
        shapely.union_all([shapely.box(0, 0, 6, 5), shapely.box(2, 5, 4.2, 6)]),  # an alcove
        shapely.union_all(
            [shapely.box(0, 0, 5, 5), shapely.box(5, 0.5, 5.1, 4.5), shapely.box(5.1, 0, 9, 5)]
        ),
    ],
)
def test_what_is_no_opening_in_a_wall_separates_nothing(floor):
    grid, _, model = painted(floor)
    drawing = make_drawing(grid, model=model)
    assert (len(drawing.doors), len(drawing.rooms)) == (0, 1)


def test_an_oblique_wall_keeps_its_angle():
    slope = math.tan(math.radians(12.0))
    grid, floor, model = painted(Polygon([(0, 0), (6, 0), (6, 3), (0, 3 + 6 * slope)]))
    drawing = make_drawing(grid, model=model)
    assert drawing.floor.hausdorff_distance(floor) < 0.02
    assert num_corners(drawing.floor) <= 5


def test_a_round_wall_stays_round():
    floor = shapely.Point(0, 0).buffer(3.0, quad_segs=64)
    grid, _, model = painted(floor)
    drawing = make_drawing(grid, model=model, angle_deg=0.0)
    assert drawing.floor.hausdorff_distance(floor) < 0.06
    assert drawing.area == pytest.approx(floor.area, rel=0.01)
    assert 12 <= num_corners(drawing.floor) <= 48


def test_cleaning_alone_puts_faces_into_the_first_cell_of_the_walls():
    frame = GridFrame(0.05, 0.0, 0.0, 100, 120)
    cells = np.full(frame.shape, UNKNOWN, np.uint8)
    cells[20:80, 20:100] = OCCUPIED
    cells[21:79, 21:99] = FREE
    drawing = make_drawing(OccupancyGrid(cells, frame), model="none")
    assert drawing.floor.bounds == pytest.approx((1.025, 1.025, 4.975, 3.975), abs=0.005)


def test_an_unknown_model_is_named():
    with pytest.raises(SlamgymError, match="no-such-weights"):
        load_floor_model("no-such-weights")


def test_a_wide_empty_margin_changes_nothing():
    grid, _, _ = painted(FLAT)
    frame = grid.frame
    cells = np.pad(grid.cells, 300, constant_values=UNKNOWN)
    side = 300 * frame.resolution
    wide = GridFrame(frame.resolution, frame.origin_x - side, frame.origin_y - side, *cells.shape)
    drawings = [make_drawing(one, model="none") for one in (grid, OccupancyGrid(cells, wide))]
    assert drawings[0].floor.equals_exact(drawings[1].floor, 1e-3)
    assert max(drawings[1].grid.cells.shape) < 300


def test_what_the_map_has_no_evidence_of_is_inferred():
    grid, _, model = painted(FLAT)
    cells = grid.cells.copy()
    right = np.flatnonzero((cells == FREE).any(axis=0))[-1]
    cells[:, right - 9 :] = UNKNOWN  # the end of the right room: 50 cm of floor, and the wall
    drawing = make_drawing(OccupancyGrid(cells, grid.frame), model=model)
    inferred = [wall for wall in drawing.walls if wall.layer == "INFERRED"]
    assert max(wall.end[0] for wall in inferred) > 7.2
    assert max(wall.length for wall in inferred) == pytest.approx(3.0, abs=0.1)
    assert sum(part.area for part in drawing.inferred_floor) == pytest.approx(1.5, abs=0.2)


def test_a_long_straight_wall_is_surer_than_the_outline_of_clutter():
    """Steps of a quarter of a metre along one side, as chairs and boxes leave them."""
    steps = [
        shapely.box(0.25 * k, 4.0, 0.25 * (k + 1), 4.25 + 0.25 * (k % 2)) for k in range(4, 28)
    ]
    grid, _, model = painted(shapely.union_all([shapely.box(0, 0, 8, 4), *steps]))
    walls = make_drawing(grid, model=model).walls
    straight = [wall.confidence for wall in walls if wall.length > 3.0]
    ragged = [
        wall.confidence for wall in walls if 2.0 < wall.start[0] < 6.0 and wall.start[1] > 4.0
    ]
    assert len(straight) >= 3
    assert len(ragged) >= 10
    assert 0.0 < max(ragged) < min(straight) - 0.15 < 0.85


def test_a_wall_between_two_rooms_is_surer_than_one_with_nothing_known_behind():
    wall = WallPiece(4 + 3j, 3j, 0.1, True)
    rooms = shapely.union_all([shapely.box(0, 0, 4, 3), shapely.box(0, 3.1, 4, 6)])
    between, outer = (
        confidences(wall_signs([wall], Evidence(painted(floor)[0])))[0]
        for floor in (rooms, shapely.box(0, 0, 4, 3))
    )
    assert 0.5 < outer < between < 1.0


def test_confidence_rises_with_the_evidence():
    evidence = Evidence(painted(shapely.box(0, 0, 12, 3))[0])
    lengths = [
        wall_signs([WallPiece(length + 3j, 3j, 0.1, False)], evidence)[0]
        for length in (0.4, 1.0, 3.0, 9.0)
    ]
    rising = confidences(np.array(lengths)).tolist()
    assert rising == sorted(rising)
    seen = np.tile(lengths[0], (4, 1))
    seen[:, 0] = (0.0, 0.3, 0.7, 1.0)
    rising = confidences(seen).tolist()
    assert rising == sorted(rising)
    assert 0.0 < rising[0] < rising[-1] < 1.0


def test_drawing_twice_gives_the_same():
    grid, _, _ = painted(FLAT, turn_deg=10.0)
    first, second = (make_drawing(grid, model="none") for _ in range(2))
    assert first.floor.equals_exact(second.floor, 0.0)
    assert first.walls == second.walls
    assert first.doors == second.doors


@pytest.mark.parametrize("factor", [0.25, 4.0])
def test_a_scale_that_makes_no_sense_is_doubted(factor):
    rooms = [shapely.box(3.1 * k, 0, 3.1 * k + 3.0, 4) for k in range(6)]
    doors = [shapely.box(3.1 * k - 0.1, 1, 3.1 * k, 1.9) for k in range(1, 6)]
    grid, _, _ = painted(shapely.union_all([*rooms, *doors]))
    assert make_drawing(grid, model="none").doubts == ()
    frame = grid.frame._replace(resolution=grid.frame.resolution * factor)
    (doubt, *_) = make_drawing(OccupancyGrid(grid.cells, frame), model="none").doubts
    assert doubt.startswith("scale doubtful")


def test_floor_that_the_robot_saw_between_walls_is_drawn_whatever_the_model_says():
    rooms = shapely.union_all(
        [shapely.box(0, 0, 4, 5), shapely.box(4, 2, 4.1, 3), shapely.box(4.1, 0, 9, 5)]
    )
    grid, _, _ = painted(rooms)
    _, _, half = painted(shapely.box(0, 0, 4, 5))
    # Its faces lie within a cell of where they were seen.
    assert make_drawing(grid, model=half).floor.area == pytest.approx(rooms.area, rel=0.03)


@pytest.mark.parametrize(
    ("side", "doubted"), [(1.5, True), (4.0, False), (10.0, False), (20.0, True)]
)
def test_floor_that_is_too_narrow_or_too_wide_for_a_building_is_a_doubtful_scale(side, doubted):
    grid, _, model = painted(shapely.box(0, 0, side, 9.0 if side < 2.0 else side))
    cells = grid.cells.copy()
    if side < 2.0:  # a rack every 40 cm
        cells[::8, :-20] = OCCUPIED
    drawing = make_drawing(OccupancyGrid(cells, grid.frame), model=model)
    assert any("a tenth of the floor" in doubt for doubt in drawing.doubts) == doubted


def test_two_directions_of_equal_right_are_doubted():
    room = shapely.box(0, 0, 6, 4)
    other = shapely.affinity.rotate(room, 30.0, origin=(0, 0))
    grid, _, model = painted(shapely.union_all([room, shapely.affinity.translate(other, 9.0, 0.0)]))
    assert any(
        doubt.startswith("direction doubtful") for doubt in make_drawing(grid, model=model).doubts
    )
    assert not any(
        "direction" in doubt for doubt in make_drawing(grid, model=model, angle_deg=0.0).doubts
    )


@pytest.mark.parametrize(
    ("value", "shape", "message"),
    [
        (UNKNOWN, (50, 50), "no free cell"),
        (FREE, (50, 50), "no occupied cell"),
        (OCCUPIED, (1, 1), "no free cell"),
    ],
)
def test_maps_without_content_are_refused(value, shape, message):
    grid = OccupancyGrid(np.full(shape, value, np.uint8), GridFrame(0.05, 0.0, 0.0, *shape))
    with pytest.raises(InputFileError, match=message):
        make_drawing(grid, model="none")


def test_a_map_of_crumbs_is_refused():
    grid, _, _ = painted(shapely.box(0, 0, 0.5, 0.5))
    with pytest.raises(InputFileError, match="check its resolution"):
        make_drawing(grid, model="none")


def test_outlines_lie_between_cells_and_enclose_holes():
    image = np.zeros((20, 30), np.float32)
    image[5:15, 4:20] = 1.0
    image[8:12, 8:12] = 0.0
    frame = GridFrame(0.1, 1.0, 2.0, 20, 30)
    outer, hole = trace_outlines(image, frame, 0.0, 0.0)
    assert outer.bounds == pytest.approx((1.4, 2.5, 3.0, 3.5))
    assert outer.is_ccw
    assert not hole.is_ccw
    assert len(trace_outlines(image, frame, 0.0, 0.2)) == 1
    image[:, 19] = (
        0.25  # an edge on which the probability falls slowly lies nearer to the cells of 1
    )
    outer, _ = trace_outlines(replace_column(image), frame, 0.0, 0.0)
    assert outer.bounds[2] == pytest.approx(1.0 + 0.1 * (18.5 + 2.0 / 3.0))


def replace_column(image):
    """The same image with nothing above or below the floor in its last column."""
    image[:5, 19] = image[15:, 19] = 0.0
    return image


def test_patches_are_what_outlines_and_their_holes_leave():
    cells = np.random.default_rng(0).random((40, 50)) < 0.6
    frame = GridFrame(0.05, 1.0, 2.0, 40, 50)
    rings = trace_outlines(cells.astype(np.float32), frame, 0.0, 0.0)
    patches = trace_patches(cells, frame, 0.0)
    assert shapely.is_valid(patches).all()
    assert sum(len(patch.interiors) for patch in patches) > 20
    outlines = shapely.get_rings(patches)
    assert {ring.normalize().wkb for ring in outlines} == {ring.normalize().wkb for ring in rings}
    signed = sum(
        shapely.area(shapely.polygons(ring)) * (1 if ring.is_ccw else -1) for ring in rings
    )
    assert shapely.area(patches).sum() == pytest.approx(signed)


def test_walls_are_sorted_into_layers_by_the_settings():
    grid, _, model = painted(FLAT)
    drawing = make_drawing(grid, model=model)
    assert {wall.layer for wall in drawing.walls} == {"SEEN"}
    assert replace(drawing, walls=(), dimensions=()).bounds == pytest.approx(
        (0.0, 0.0, 7.3, 5.0), abs=0.02
    )


def test_parts_that_touch_in_one_corner_are_brought_to_the_grid():
    """Three parts with a corner in common, from a robot's map: the buffers that part them cross themselves."""
    wide = [
        (-50.2193627160217, 39.29510604380481), (-50.1538607594657, 39.226659360934335),
        (-49.959429493141975, 39.24170696460208), (-49.96921141936707, 39.3681), (-49.6989, 39.3681),
        (-49.6989, 38.5681), (-49.77859480954777, 38.5681), (-49.780540224790215, 38.59323686281659),
        (-49.90847620411155, 38.583335523654064), (-49.93920726072663, 38.980413914676966),
        (-50.09888337832337, 38.968056113494946), (-50.09888337832337, 38.96805611349494),
        (-50.4989, 38.93709765862649), (-50.4989, 39.3681), (-50.37813599777408, 39.3681),
    ]  # fmt: skip
    corner = (-50.09832487017739, 38.960839585968564)
    below = [
        corner, (-50.073153349921526, 38.63559639996306), (-50.228424091710295, 38.623579543683675),
        (-50.35861989896993, 38.757250000623905),
    ]  # fmt: skip
    sliver = [
        (-50.08802379040755, 38.96889656872646),
        corner,
        (-50.09888337832337, 38.96805611349494),
    ]
    floor = shapely.MultiPolygon([Polygon(part) for part in (wide, below, sliver)])
    assert without_necks(floor).is_valid
