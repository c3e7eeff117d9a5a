import math
import pickle

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import MultiPolygon, Polygon

from slamgym.cad import Door, FloorPlan, Room, check_plan, generate_plan, robot_space
from slamgym.core.errors import PlanError
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, GridFrame

SQUARE = shapely.box(0, 0, 6, 4)
PILLAR = shapely.box(2, 1, 3, 2)


def plan_of(space, **fields):
    return FloorPlan("p", space, source="p.json", **fields)


@given(
    centre=st.tuples(st.floats(-5, 5), st.floats(-5, 5)),
    radii=st.lists(st.floats(0.5, 3.0), min_size=3, max_size=14),
    resolution=st.sampled_from([0.02, 0.05, 0.1]),
)
def test_the_raster_has_the_area_of_the_polygon(centre, radii, resolution):
    # A star-shaped polygon of any corners. A cell can only be wrong if the outline crosses it, by its area at
    # most, and a line of length L crosses no more than 2 L / resolution + 2 cells.
    angles = np.linspace(0, 2 * math.pi, len(radii), endpoint=False)
    space = Polygon(
        [
            (centre[0] + r * math.cos(a), centre[1] + r * math.sin(a))
            for r, a in zip(radii, angles, strict=True)
        ]
    )
    plan = plan_of(space)
    grid = plan.raster(resolution)
    area = (grid.cells == FREE).sum() * resolution**2
    bound = 2 * space.length * resolution + 2 * len(radii) * resolution**2
    assert abs(area - space.area) <= bound


@given(seed=st.integers(0, 50), column=st.integers(0, 10**6), row=st.integers(0, 10**6))
@settings(max_examples=30)
def test_a_cell_is_free_exactly_if_its_centre_is_in_the_free_space(seed, column, row):
    plan = generate_plan(seed)
    grid = plan.raster(0.07)
    row, column = row % grid.frame.height_px, column % grid.frame.width_px
    x, y = grid.frame.to_point(row, column)
    point = shapely.Point(float(x), float(y))
    if plan.free_space.boundary.distance(point) > 1e-9:
        assert (grid.cells[row, column] == FREE) == plan.free_space.contains(point)


def test_a_box_on_the_lattice_is_drawn_to_the_cell():
    frame = GridFrame(0.5, -1.0, -1.0, 12, 16)
    cells = plan_of(SQUARE.difference(PILLAR)).raster(0.5, frame).cells
    expected = np.zeros((12, 16), np.uint8)
    expected[2:10, 2:14] = FREE
    expected[6:8, 6:8] = OCCUPIED
    np.testing.assert_array_equal(cells, expected)


def test_offset_moves_the_plan_into_the_map_frame():
    plan = plan_of(SQUARE.difference(PILLAR))
    there = plan.raster(0.1, GridFrame(0.1, -1.0, -1.0, 60, 80))
    moved = plan.raster(0.1, GridFrame(0.1, -3.5, -2.0, 60, 80), offset=(2.5, 1.0))
    np.testing.assert_array_equal(there.cells, moved.cells)


def test_a_frame_elsewhere_is_all_wall():
    assert (plan_of(SQUARE).raster(0.1, GridFrame(0.1, 100.0, 100.0, 5, 5)).cells == OCCUPIED).all()
    cells = plan_of(SQUARE).raster(0.1, GridFrame(0.1, 100.0, 100.0, 5, 5), outside=UNKNOWN).cells
    assert (cells == UNKNOWN).all()


def test_outside_marks_only_what_lies_behind_the_walls():
    grid = plan_of(SQUARE).raster(
        0.1, GridFrame(0.1, -1.0, -1.0, 60, 80), outside=UNKNOWN, wall_thickness=0.2
    )
    middle = grid.cells[30]
    assert list(middle[:12]) == [UNKNOWN] * 8 + [OCCUPIED] * 2 + [FREE] * 2


def test_a_raster_refuses_a_frame_of_another_resolution():
    with pytest.raises(ValueError, match=r"frame's is 0\.2"):
        plan_of(SQUARE).raster(0.1, GridFrame(0.2, 0, 0, 5, 5))
    with pytest.raises(ValueError, match="above 0"):
        plan_of(SQUARE).raster(0.0)


def test_segments_are_the_closed_rings_and_can_not_be_changed():
    plan = plan_of(SQUARE.difference(PILLAR))
    segments = plan.segments()
    assert segments.shape == (8, 4)
    assert segments is plan.segments()
    assert np.hypot(*(segments[:, 2:] - segments[:, :2]).T).sum() == pytest.approx(
        plan.free_space.length
    )
    with pytest.raises(ValueError, match="read-only"):
        segments[0, 0] = 1.0


def test_a_plan_survives_pickling():
    plan = generate_plan(3)
    plan.segments()
    assert pickle.loads(pickle.dumps(plan)) == plan


def test_the_width_of_a_door_is_the_distance_of_its_jambs():
    assert Door((1, 1), (1.6, 1.8)).width == pytest.approx(1.0)


def test_robot_space_keeps_the_radius_from_every_wall():
    space = robot_space(plan_of(SQUARE), 0.5)
    assert space.bounds == pytest.approx((0.5, 0.5, 5.5, 3.5))
    assert robot_space(plan_of(SQUARE), 2.5).is_empty


def polygon_with_nan():
    with np.errstate(invalid="ignore"):  # shapely computes with the coordinates and would warn
        return Polygon([(0, 0), (math.nan, 0), (1, 1)])


NARROW = shapely.union_all(
    [shapely.box(0, 0, 4, 4), shapely.box(4, 1, 5, 1.4), shapely.box(5, 0, 9, 4)]
)
CLOSET = shapely.union_all(
    [shapely.box(0, 0, 9, 9), shapely.box(9, 1, 9.2, 1.4), shapely.box(9.2, 0, 11, 2)]
)


@pytest.mark.parametrize(
    ("plan", "reason"),
    [
        (plan_of(MultiPolygon([SQUARE, shapely.box(10, 0, 12, 2)])), "2 disjoint parts"),
        (plan_of(Polygon()), "no area"),
        (plan_of(Polygon([(0, 0), (1, 0), (2, 0)])), "no area"),
        (plan_of(Polygon([(0, 0), (2, 2), (2, 0), (0, 2.5)])), r"invalid \(Self-intersection"),
        (plan_of(polygon_with_nan()), "NaN"),
        (plan_of(SQUARE.boundary), "LineString, not a polygon"),
        (plan_of(shapely.box(0, 0, 70, 5)), r"70\.0 m long but the map holds 64\.0 m"),
        (plan_of(shapely.box(0, 0, 10, 0.4)), "no place is wide enough"),
        (plan_of(NARROW), "only 49% of the floor"),
        (
            plan_of(CLOSET, rooms=(Room("Storage", shapely.box(9.2, 0, 11, 2)),)),
            "enter 1 room.*Storage",
        ),
    ],
)
def test_each_fault_gets_one_sentence_that_names_the_file(plan, reason):
    with pytest.raises(PlanError, match=reason) as caught:
        check_plan(plan, robot_radius=0.22, max_extent=64.0)
    assert str(caught.value).startswith("p.json: ")
    assert "\n" not in str(caught.value)


def test_a_small_closet_may_stay_closed():
    check_plan(plan_of(CLOSET), robot_radius=0.22)
    check_plan(plan_of(CLOSET, rooms=(Room("Room", shapely.box(0, 0, 9, 9)),)), robot_radius=0.22)
    check_plan(plan_of(NARROW), robot_radius=0.18)


def test_a_turned_plan_keeps_its_measures():
    plan = generate_plan(3)
    turned = plan.turned(30.0)
    assert turned.area == pytest.approx(plan.area)
    assert [door.width for door in turned.doors] == pytest.approx(
        [door.width for door in plan.doors]
    )
    assert turned.turned(-30.0).free_space.symmetric_difference(plan.free_space).area < 1e-6
    steps = np.diff(turned.segments().reshape(-1, 2, 2), axis=1)[:, 0]
    along = np.degrees(np.arctan2(steps[:, 1], steps[:, 0])) % 90.0
    assert np.median(along) == pytest.approx(30.0)
    assert plan.turned(0.0) is plan
