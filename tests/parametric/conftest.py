"""A flat with six rooms and a tour through them, shared by the tests of the parametric model."""

import numpy as np
import pytest
import shapely

from slamgym.cad.floorplan import FloorPlan
from slamgym.core.types import Trajectory
from slamgym.parametric.paths import Waypoints, drive

WALLS = [
    (3.0, 0.0, 3.1, 2.0),
    (3.0, 3.0, 3.1, 6.0),
    (6.0, 0.0, 6.1, 3.5),
    (6.0, 4.5, 6.1, 6.0),
    (0.0, 3.0, 1.0, 3.1),
    (2.0, 3.0, 3.0, 3.1),
]
TOUR = np.array(
    [
        [1.5, 1.5],
        [2.5, 2.5],
        [4.5, 2.5],
        [4.5, 4.0],
        [7.5, 4.0],
        [7.5, 1.5],
        [7.5, 4.0],
        [4.5, 4.0],
        [4.5, 2.5],
        [1.5, 2.5],
        [1.5, 4.5],
    ]
)


@pytest.fixture(scope="session")
def flat() -> FloorPlan:
    free = shapely.box(0.0, 0.0, 9.0, 6.0)
    for wall in WALLS:
        free = free.difference(shapely.box(*wall))
    return FloorPlan(id="flat", free_space=free)


@pytest.fixture(scope="session")
def tour(flat: FloorPlan) -> Trajectory:
    return drive(Waypoints(TOUR))


@pytest.fixture(scope="session")
def tour_points() -> np.ndarray:
    return TOUR
