"""What is pasted lies where it should, and nowhere else."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from slamgym.core.geometry import paste

SIDE = st.integers(1, 6)
OFFSET = st.integers(-9, 9)


@given(SIDE, SIDE, SIDE, SIDE, OFFSET, OFFSET)
def test_a_canvas_holds_the_picture_as_far_as_it_reaches(height, width, rows, cols, top, left):
    picture = np.arange(1, 2 * rows * cols + 1).reshape(2, rows, cols)
    canvas = np.zeros((2, height, width), dtype=np.int64)
    paste(canvas, picture, top, left)
    for row, col in np.ndindex(height, width):
        r, c = row + top, col + left
        there = picture[:, r, c] if 0 <= r < rows and 0 <= c < cols else 0
        assert (canvas[:, row, col] == there).all()
