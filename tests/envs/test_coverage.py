"""True coverage: what counts as floor, and what counts as seen."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgym.cad import FloorPlan
from slamgym.core.geometry import compose, unit_vectors
from slamgym.core.types import Pose2D
from slamgym.envs.coverage import CELL, Coverage, ReachableFloor, sweep
from slamgym.sim import Lidar, LidarConfig
from slamgym.sim.passages import Passages

LIDAR = Lidar(LidarConfig())
RADIUS = 0.22


def coverage_of(plan: FloorPlan, x: float, y: float) -> Coverage:
    floor = ReachableFloor(plan, RADIUS)
    cells = floor.mask(x, y)
    return Coverage(cells, cells.copy(), floor.frame)


def look(coverage: Coverage, plan: FloorPlan, pose: Pose2D, usable: float = 3.0) -> float:
    ranges = LIDAR.true_ranges(pose, plan.segments())
    sensor = compose(pose, LIDAR.geometry.mount)
    directions = unit_vectors(LIDAR.geometry.angles)
    left, bottom = coverage.frame.origin_x, coverage.frame.origin_y
    sweep(coverage.unseen, left, bottom, CELL, *sensor, directions, ranges, usable)
    return coverage.share


def test_a_room_without_nooks_counts_whole(hall: FloorPlan):
    # A disc that touches both walls of a square corner leaves out (sqrt 2 - 1) of its radius, which the
    # dilation gives back; 0.1 m cells have their centres inside.
    assert np.count_nonzero(ReachableFloor(hall, RADIUS).mask(1.5, 1.5)) * CELL**2 == pytest.approx(
        9.0
    )


def test_only_the_part_that_the_robot_reaches_counts():
    # A gap of 0.4 m is too narrow for a robot of 0.44 m.
    space = shapely.union_all(
        [shapely.box(0, 0, 4, 4), shapely.box(4, 1.8, 4.5, 2.2), shapely.box(4.5, 0, 6.5, 4)]
    )
    floor = ReachableFloor(FloorPlan("gap", space), RADIUS)
    left = floor.mask(1.0, 1.0)
    right = floor.mask(6.0, 1.0)
    # The gap's mouth may count as far as the dilation reaches into it.
    assert np.count_nonzero(left) * CELL**2 == pytest.approx(16.0, abs=0.2)
    assert np.count_nonzero(right) * CELL**2 == pytest.approx(8.0, abs=0.2)
    assert not (left & right).any()


def test_furniture_takes_floor_away(hall: FloorPlan):
    passages = Passages(hall, 0.5)
    cupboard = np.array([0.5, 0.5, 1.0, 0.0, 0.5, 0.5])
    passages.block(cupboard)
    floor = ReachableFloor(hall, RADIUS, passages).mask(2.0, 2.0)
    assert np.count_nonzero(floor) * CELL**2 == pytest.approx(8.0, abs=0.05)


def test_everything_swept_is_one(flat: FloorPlan):
    coverage = coverage_of(flat, 1.0, 1.0)
    rng = np.random.default_rng(0)
    room = shapely.get_parts(flat.free_space.buffer(-RADIUS))[0]
    for _ in range(3000):
        x, y = rng.uniform((0, 0), (7.2, 4))
        if room.contains(shapely.Point(x, y)):
            look(coverage, flat, Pose2D(x, y, rng.uniform(-np.pi, np.pi)))
    assert coverage.share == 1.0
    assert np.array_equal(coverage.seen[::-1], ReachableFloor(flat, RADIUS).mask(1.0, 1.0))


@settings(max_examples=25)
@given(
    st.lists(
        st.tuples(st.floats(0.3, 3.7), st.floats(0.3, 3.7), st.floats(-3, 3)),
        min_size=1,
        max_size=8,
    )
)
def test_coverage_only_grows_and_stays_a_share(poses):
    plan = FloorPlan("room", shapely.box(0, 0, 4, 4))
    coverage = coverage_of(plan, 2.0, 2.0)
    shares = [look(coverage, plan, Pose2D(*pose)) for pose in poses]
    assert shares == sorted(shares)
    assert shares[0] > 0.0
    assert shares[-1] <= 1.0
    assert look(coverage, plan, Pose2D(*poses[0])) == shares[-1]  # nothing is seen twice


def test_a_wall_hides_the_next_room(flat: FloorPlan):
    coverage = coverage_of(flat, 1.0, 1.0)
    look(coverage, flat, Pose2D(2.5, 3.5, 0.0))  # from above the door's upper jamb, at y = 2.5
    rows, cols = np.nonzero(coverage.seen)
    x, y = coverage.frame.to_point(rows, cols)
    beyond = x > 4.2
    assert beyond.any()
    assert y[beyond].max() < 2.5


def test_the_usable_range_ends_sight():
    plan = FloorPlan("corridor", shapely.box(0, 0, 20, 1))
    coverage = coverage_of(plan, 1.0, 0.5)
    look(coverage, plan, Pose2D(1.0, 0.5, 0.0), usable=2.0)
    columns = np.flatnonzero(coverage.seen.any(axis=0))
    sensor = 1.0 + LIDAR.geometry.mount.x
    furthest = coverage.frame.origin_x + (columns[-1] + 1) * CELL
    assert sensor + 2.0 - CELL < furthest <= sensor + 2.0 + CELL


def test_coverage_does_not_depend_on_where_the_plan_lies():
    shares = []
    for x, y in ((0.0, 0.0), (1024.0, -512.0)):
        plan = FloorPlan("l", shapely.box(x, y, x + 5.0, y + 3.0))
        coverage = coverage_of(plan, x + 1.0, y + 1.0)
        shares.append(look(coverage, plan, Pose2D(x + 1.0, y + 1.0, 0.4)))
    assert shares[0] == pytest.approx(shares[1], abs=2e-3)  # a cell or two may round the other way
