"""Buildings that are small enough to reason about."""

import pytest
import shapely

from slamgym.cad import FloorPlan


def two_rooms(shift: tuple[float, float] = (0.0, 0.0)) -> FloorPlan:
    """A left room of 4 x 4 m and a right one of 3 x 4 m, joined by a door of 1 m."""
    left = shapely.box(0, 0, 4, 4)
    right = shapely.box(4.2, 0, 7.2, 4)
    door = shapely.box(3.9, 1.5, 4.3, 2.5)
    space = shapely.union_all([left, right, door])
    return FloorPlan("two_rooms", shapely.affinity.translate(space, *shift))


@pytest.fixture
def flat() -> FloorPlan:
    return two_rooms()


@pytest.fixture
def hall() -> FloorPlan:
    """One square room of 3 m that the scanner overlooks from anywhere."""
    return FloorPlan("hall", shapely.box(0, 0, 3, 3))
