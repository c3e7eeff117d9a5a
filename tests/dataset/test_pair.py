import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely import Polygon, box

from slamgym.cad import FloorPlan
from slamgym.core.errors import ConfigError
from slamgym.core.types import FREE, UNKNOWN, GridFrame, OccupancyGrid, Pose2D
from slamgym.dataset.record import PairConfig, common_frame, make_pair, place

RESOLUTION = 0.05


def lattice_frame(col, row, width, height):
    """A grid whose cell borders lie at multiples of the resolution, as SLAM maps have them."""
    return GridFrame(RESOLUTION, col * RESOLUTION, row * RESOLUTION, height, width)


coordinates = st.floats(-40.0, 40.0)


@given(
    coordinates,
    coordinates,
    st.floats(0.1, 20.0),
    st.floats(0.1, 20.0),
    st.integers(-500, 500),
    st.integers(-500, 500),
    st.integers(1, 200),
    st.integers(1, 200),
    st.floats(0.0, 2.0),
)
def test_the_common_frame_covers_both_on_the_maps_lattice(
    x, y, dx, dy, col, row, width, height, margin
):
    grid = lattice_frame(col, row, width, height)
    frame = common_frame((x, y, x + dx, y + dy), grid, margin)
    low_x, low_y, high_x, high_y = frame.bounds
    # 1e-6 cells of rounding are allowed to either side.
    slack = 1e-5 * RESOLUTION
    assert low_x <= min(x, grid.bounds[0]) - margin + slack
    assert low_y <= min(y, grid.bounds[1]) - margin + slack
    assert high_x >= max(x + dx, grid.bounds[2]) + margin - slack
    assert high_y >= max(y + dy, grid.bounds[3]) + margin - slack
    for origin in (frame.origin_x, frame.origin_y):
        assert origin / RESOLUTION == pytest.approx(round(origin / RESOLUTION), abs=1e-6)
    smallest = (max(x + dx, grid.bounds[2]) - min(x, grid.bounds[0]) + 2 * margin) / RESOLUTION
    assert frame.width_px < smallest + 2


@given(
    st.integers(-60, 60),
    st.integers(-60, 60),
    st.integers(1, 40),
    st.integers(1, 40),
    st.integers(0, 2**32 - 1),
)
def test_placing_moves_no_cell(col, row, width, height, seed):
    cells = np.random.default_rng(seed).choice(np.array([0, 205, 254], np.uint8), (height, width))
    grid = OccupancyGrid(cells, lattice_frame(col, row, width, height))
    frame = common_frame((-1.0, -2.0, 1.5, 0.5), grid.frame, 0.3)
    placed = place(grid, frame)
    rows, cols = np.indices(cells.shape)
    to_row, to_col = frame.to_cell(*grid.frame.to_point(rows, cols))
    assert (placed[to_row, to_col] == cells).all()
    assert (placed != UNKNOWN).sum() == (cells != UNKNOWN).sum()


def test_a_perfect_map_lies_on_the_plan():
    room = Polygon([(2.0, 1.0), (6.0, 1.0), (6.0, 4.0), (2.0, 4.0)])
    plan = FloorPlan("room", room)
    start = Pose2D(3.13, 2.21, 0.7)
    # What a perfect mapper would know: exactly the room, in the map frame, on the map's lattice.
    frame = GridFrame(RESOLUTION, -40 * RESOLUTION, -40 * RESOLUTION, 100, 120)
    slam_map = plan.raster(RESOLUTION, frame=frame, offset=(start.x, start.y))
    pair = make_pair(plan, start, slam_map, PairConfig(margin=0.4))
    assert pair.cad.shape == pair.slam.shape == pair.frame.shape
    assert ((pair.slam == FREE) == (pair.cad == FREE)).all()


def test_the_cad_side_shows_the_room_where_it_is():
    plan = FloorPlan("room", box(2.0, 1.0, 6.0, 4.0))
    start = Pose2D(3.0, 2.0, 0.0)
    slam_map = OccupancyGrid(np.full((2, 2), 205, np.uint8), lattice_frame(0, 0, 2, 2))
    pair = make_pair(plan, start, slam_map, PairConfig())
    assert (pair.cad == FREE).sum() * RESOLUTION**2 == pytest.approx(12.0)
    row, col = pair.frame.to_cell([2.9, 3.1, 0.0], [0.0, 0.0, 1.9])
    assert pair.cad[row, col].tolist() == [254, 0, 254]


@pytest.mark.parametrize("margin", [-0.1, float("nan"), 1000.0])
def test_a_senseless_margin_is_refused(margin):
    with pytest.raises(ConfigError, match="margin"):
        PairConfig(margin=margin)
