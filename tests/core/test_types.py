import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slamgym.core.types import FREE, GridFrame, LaserGeometry, OccupancyGrid, Trajectory

frames = st.builds(
    GridFrame,
    resolution=st.floats(0.01, 0.5),
    origin_x=st.floats(-50, 50),
    origin_y=st.floats(-50, 50),
    height_px=st.integers(1, 500),
    width_px=st.integers(1, 500),
)


@given(frames, st.data())
def test_the_centre_of_a_cell_lies_in_that_cell(frame, data):
    row = data.draw(st.integers(0, frame.height_px - 1))
    col = data.draw(st.integers(0, frame.width_px - 1))
    assert tuple(int(v) for v in frame.to_cell(*frame.to_point(row, col))) == (row, col)


@given(frames)
def test_row_zero_is_the_top_of_the_picture(frame):
    _, y_top = frame.to_point(0, 0)
    _, y_bottom = frame.to_point(frame.height_px - 1, 0)
    assert y_top >= y_bottom
    assert frame.bounds[1] < y_bottom


@given(
    st.floats(-20, 20), st.floats(-20, 20), st.floats(0.1, 30), st.floats(0.1, 30), st.floats(0, 2)
)
def test_a_covering_frame_contains_its_bounds(x, y, width, height, margin):
    bounds = (x, y, x + width, y + height)
    covering = GridFrame.covering(bounds, 0.05, margin).bounds
    slack = 1e-6  # a frame may fall short by the rounding of its cell count
    assert covering[0] <= x - margin + slack
    assert covering[1] <= y - margin + slack
    assert covering[2] >= x + width + margin - slack
    assert covering[3] >= y + height + margin - slack


def test_a_grid_refuses_cells_of_another_shape():
    with pytest.raises(ValueError, match="shape"):
        OccupancyGrid(np.full((2, 3), FREE, np.uint8), GridFrame(0.05, 0.0, 0.0, 3, 2))


def test_beam_angles_start_at_the_minimum_and_grow_by_the_increment():
    geometry = LaserGeometry(3, -1.0, 0.5, 0.1, 3.5)
    np.testing.assert_allclose(geometry.angles, [-1.0, -0.5, 0.0])


def test_the_length_of_a_trajectory_is_the_sum_of_its_steps():
    poses = np.array([[0.0, 0.0, 0.0], [3.0, 4.0, 1.0], [3.0, 5.0, 0.0]])
    assert Trajectory(np.arange(3.0), poses).length == pytest.approx(6.0)
