"""The map's error against the truth."""

import numpy as np
import pytest
import shapely

from slamgym.cad import FloorPlan
from slamgym.core.types import FREE, OCCUPIED, GridFrame, OccupancyGrid, Pose2D
from slamgym.envs import ExploreEnv
from slamgym.metrics.map_error import ObstacleDistance

SQUARE = FloorPlan("square", shapely.box(0, 0, 4, 3))


def grid_with(points: list[tuple[float, float]]) -> OccupancyGrid:
    frame = GridFrame(0.05, -1.0, -1.0, 120, 120)
    cells = np.full(frame.shape, FREE, dtype=np.uint8)
    for x, y in points:
        row, col = frame.to_cell(x, y)
        cells[row, col] = OCCUPIED
    return OccupancyGrid(cells, frame)


@pytest.mark.parametrize(
    ("point", "distance"),
    [((2.0, 0.5), 0.5), ((2.0, 1.2), 1.2), ((0.8, 1.5), 0.8), ((4.6, 3.8), 1.0), ((2.0, 3.0), 0.0)],
)
def test_distance_is_that_to_the_nearest_wall(point, distance):
    error = ObstacleDistance(SQUARE.segments()).mean_error(grid_with([point]), Pose2D(0.0, 0.0, 0.0))
    # Half a diagonal of the map's cell, plus the rounding of the field's.
    assert error == pytest.approx(distance, abs=0.0354 + 0.025)


def test_errors_are_averaged_in_the_world():
    walls = ObstacleDistance(SQUARE.segments() + np.array([10.0, 20.0, 10.0, 20.0]))
    grid = grid_with([(2.0, 0.5), (2.0, 1.0)])
    assert walls.mean_error(grid, Pose2D(10.0, 20.0, 0.0)) == pytest.approx(0.75, abs=0.06)
    assert walls.mean_error(grid_with([]), Pose2D(0.0, 0.0, 0.0)) == 0.0


def test_a_map_made_without_errors_has_none_but_its_cells(flat: FloorPlan):
    env = ExploreEnv(flat, localization="ground_truth", lidar="exact", reward={"map_error": 1.0})
    _, info = env.reset(seed=0)
    for i in range(50):
        info = env.step((0.3, 1.0 if i % 20 < 10 else -1.0))[4]
    # A hit lies anywhere in its 5 cm cell; the centre is then 1.25 cm away in the mean for a wall parallel to
    # the grid, and the distance field rounds by up to half of its own cell.
    assert 0.0 < info["map_error"] < 0.026
