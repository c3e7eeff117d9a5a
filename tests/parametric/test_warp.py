"""Signs and the fixed point of the warp."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from slamgym.core.geometry import compose, inverse, transform_points
from slamgym.core.types import FREE, OCCUPIED, GridFrame, Pose2D
from slamgym.parametric.config import ScannerView
from slamgym.parametric.visibility import observe
from slamgym.parametric.warp import densify, displacements, invert, warp

R = 0.05  # [m/cell]


def with_wall(row: int, col: int, shape=(40, 50)):
    cells = np.full(shape, FREE, dtype=np.uint8)
    cells[row, col] = OCCUPIED
    return cells


def constant(x: float, y: float, shape=(40, 50)):
    return np.stack([np.full(shape, x), np.full(shape, y)]).astype(np.float32)


def wall_of(cells):
    rows, cols = np.nonzero(cells == OCCUPIED)
    return list(zip(rows.tolist(), cols.tolist(), strict=True))


def test_three_cells_in_x_move_a_wall_three_cells_to_the_left() -> None:
    assert wall_of(warp(with_wall(20, 25), constant(3 * R, 0.0), R, FREE)) == [(20, 22)]


def test_three_cells_in_y_move_a_wall_three_rows_down() -> None:
    # true minus measured is up, so it is measured below its place; rows grow downwards.
    assert wall_of(warp(with_wall(20, 25), constant(0.0, 3 * R), R, FREE)) == [(23, 25)]


@given(dx=st.integers(-6, 6), dy=st.integers(-6, 6))
def test_flipping_y_flips_the_rows(dx, dy) -> None:
    cells = with_wall(18, 25)
    out = warp(cells, constant(dx * R, dy * R), R, FREE)
    flipped = warp(cells[::-1].copy(), constant(dx * R, -dy * R), R, FREE)
    np.testing.assert_array_equal(out, flipped[::-1])


@given(
    moved=st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-0.3, 0.3)),
    heading=st.floats(-3.0, 3.0),
)
def test_a_scan_displaces_what_it_draws_as_one_piece(moved, heading) -> None:
    """What lies at a place of the robot's frame is drawn at the same place of where it believed to be."""
    frame = GridFrame(R, -1.0, -1.0, 40, 50)
    true = np.array([[0.1, 0.2, heading]])
    believed = true + moved
    visibility = observe(np.zeros(frame.shape, dtype=bool), frame, true, ScannerView(mount_x=0.0))
    field = displacements(true, believed, visibility)
    points = frame.to_points(*np.nonzero(visibility.seen))
    drawn = transform_points(compose(Pose2D(*believed[0]), inverse(Pose2D(*true[0]))), points)
    np.testing.assert_allclose((points - drawn).T, field[:, visibility.seen], atol=1e-5)
    assert not field[:, ~visibility.seen].any()


def test_no_displacement_is_the_identity() -> None:
    cells = np.random.default_rng(0).choice(np.array([0, 205, 254], dtype=np.uint8), (40, 50))
    np.testing.assert_array_equal(warp(cells, constant(0.0, 0.0), R, 205), cells)


@given(
    turn=st.floats(-0.12, 0.12),
    shift_x=st.floats(-0.4, 0.4),
    shift_y=st.floats(-0.4, 0.4),
    wave=st.floats(0.0, 0.1),
)
def test_walls_placed_forwards_land_on_walls_of_the_output(turn, shift_x, shift_y, wave) -> None:
    # A rigid motion of up to 7 degrees and 10 cells, with a wave on top: drifts as large as the model makes.
    shape = (200, 220)
    rows, cols = np.indices(shape)
    x = (cols - 110) * R
    y = (100 - rows) * R
    wobble = wave * np.sin(2.0 * np.pi * x / 4.0)
    new_x = np.cos(turn) * x - np.sin(turn) * y + shift_x
    new_y = np.sin(turn) * x + np.cos(turn) * y + shift_y + wobble
    forward = np.stack([x - new_x, y - new_y]).astype(np.float32)
    inverse = invert(forward, R)
    walls = np.random.default_rng(0).integers(60, 140, (60, 2))
    for row, col in walls:
        to_row = row + forward[1, row, col] / R
        to_col = col - forward[0, row, col] / R
        at = round(to_row), round(to_col)
        back_row = at[0] - inverse[1][at] / R
        back_col = at[1] + inverse[0][at] / R
        # One cell: half a cell of rounding the landing place in either axis, stretched by the local slope.
        assert np.hypot(back_row - row, back_col - col) <= 1.0


def test_densify_takes_the_nearest_known_value() -> None:
    field = np.zeros((2, 20, 30), dtype=np.float32)
    known = np.zeros((20, 30), dtype=bool)
    field[:, 5, 5] = (0.1, 0.2)
    field[:, 15, 25] = (-0.3, 0.4)
    known[5, 5] = known[15, 25] = True
    dense = densify(field, known, 0.0)
    np.testing.assert_allclose(dense[:, 0, 0], [0.1, 0.2], atol=1e-7)
    np.testing.assert_allclose(dense[:, 19, 29], [-0.3, 0.4], atol=1e-7)
    assert np.isin(dense[0], np.array([0.1, -0.3], dtype=np.float32)).all()


def test_densify_of_nothing_is_zero_and_smoothing_keeps_a_constant() -> None:
    shape = (2, 20, 30)
    assert not densify(np.ones(shape, dtype=np.float32), np.zeros(shape[1:], dtype=bool), 2.0).any()
    smooth = densify(np.ones(shape, dtype=np.float32), np.ones(shape[1:], dtype=bool), 2.0)
    np.testing.assert_allclose(smooth, 1.0, atol=1e-6)
