"""Floor plans to drive in."""

import numpy as np
import pytest
import shapely

from slamgym.cad.floorplan import Door, FloorPlan, Room


def random_plan(rng):
    """Overlapping turned rooms with stumps of walls, pillars and gaps too narrow for the robot."""
    rooms = []
    at = np.zeros(2)
    for _ in range(rng.integers(2, 5)):
        width, depth = rng.uniform(1.2, 4.0, 2)
        room = shapely.box(-width / 2, -depth / 2, width / 2, depth / 2)
        room = shapely.affinity.rotate(room, rng.choice([0.0, 0.0, rng.uniform(0, 90)]))
        rooms.append(shapely.affinity.translate(room, *at))
        at = at + rng.uniform(-1.5, 1.5, 2)
    free = shapely.union_all(rooms)
    for _ in range(rng.integers(1, 5)):
        start = np.array([rng.uniform(*free.bounds[::2]), rng.uniform(*free.bounds[1::2])])
        end = start + rng.uniform(-2, 2, 2)
        free = free.difference(
            shapely.LineString([start, end]).buffer(rng.choice([0.005, 0.05]), cap_style="flat")
        )
    parts = [part for part in shapely.get_parts(free) if part.area > 0.01]
    return FloorPlan("random", max(parts, key=lambda part: part.area))


@pytest.fixture
def make_random_plan():
    return random_plan


@pytest.fixture
def hall():
    """8 x 6 m without anything in it."""
    return FloorPlan("hall", shapely.box(0, 0, 8, 6))


@pytest.fixture
def flat():
    """Four furnished rooms in a row of two, with doors of 0.9 m."""
    boxes = {
        "Bedroom": (0, 0, 4, 3.5),
        "Kitchen": (4.1, 0, 8.5, 3.5),
        "Living_Room": (0, 3.6, 5, 8),
        "Bathroom": (5.1, 3.6, 8.5, 8),
    }
    openings = [(3.9, 1.5, 4.2, 2.4), (1.5, 3.4, 2.4, 3.7), (4.9, 5, 5.2, 5.9)]
    rooms = tuple(Room(name, shapely.box(*box)) for name, box in boxes.items())
    free = shapely.union_all([shapely.box(*box) for box in (*boxes.values(), *openings)])
    doors = (Door((4.05, 1.5), (4.05, 2.4)), Door((1.5, 3.55), (2.4, 3.55)))
    return FloorPlan("flat", free, rooms, doors)
