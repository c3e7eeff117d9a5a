"""The two errors of a map against the truth."""

import numpy as np
import pytest
import shapely

from slamgym.cad import FloorPlan
from slamgym.core.types import FREE, OCCUPIED, GridFrame, OccupancyGrid, Pose2D
from slamgym.metrics.map_error import ObstacleDistance, wall_error, wall_faces

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
    error = ObstacleDistance(SQUARE.segments()).mean_error(
        grid_with([point]), Pose2D(0.0, 0.0, 0.0)
    )
    # Half a diagonal of the map's cell, plus the rounding of the field's.
    assert error == pytest.approx(distance, abs=0.0354 + 0.025)


def test_errors_are_averaged_in_the_world():
    walls = ObstacleDistance(SQUARE.segments() + np.array([10.0, 20.0, 10.0, 20.0]))
    grid = grid_with([(2.0, 0.5), (2.0, 1.0)])
    assert walls.mean_error(grid, Pose2D(10.0, 20.0, 0.0)) == pytest.approx(0.75, abs=0.06)
    assert walls.mean_error(grid_with([]), Pose2D(0.0, 0.0, 0.0)) == 0.0


def room(shift_px=0):
    """Values of a room of 4 x 5 m; its right wall is moved by some cells and one cell thick."""
    cells = np.full((120, 140), 205, np.uint8)
    cells[20:100, 20 : 120 + shift_px] = FREE
    cells[20:100, 120 + shift_px] = OCCUPIED
    return cells


def drawing():
    cad = np.zeros((120, 140), np.uint8)
    cad[20:100, 20:120] = FREE
    return cad


def test_wall_faces_are_the_wall_cells_beside_free_space():
    faces = wall_faces(drawing() == FREE)
    assert faces.sum() == 2 * (100 + 80) + 4
    assert not (faces & (drawing() == FREE)).any()


@pytest.mark.parametrize("shift_px", [0, 3, 8])
def test_a_moved_wall_errs_by_as_much_as_it_was_moved(shift_px):
    assert wall_error(room(shift_px), drawing(), 0.05) == pytest.approx(0.05 * shift_px, abs=1e-6)


def test_a_map_without_walls_has_no_wall_error():
    assert wall_error(np.full((120, 140), 205, np.uint8), drawing(), 0.05) == 0.0
