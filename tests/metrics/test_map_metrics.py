import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgym.metrics import (
    Similarity,
    aligned_error,
    apply_similarity,
    squared_error,
    wall_score,
)  # fmt: skip
from slamgym.metrics.alignment import moved_error


def flat(size=96):
    """An L-shaped flat with an inner wall: it looks like nothing else when turned or mirrored."""
    image = np.zeros((size, size))
    image[20:70, 15:80] = 1
    image[55:70, 50:80] = 0
    image[40:43, 15:50] = 0
    return image


@settings(max_examples=8)
@given(st.floats(-0.08, 0.08), st.floats(-0.08, 0.08), st.floats(-3.1, 3.1), st.floats(-0.15, 0.15))
def test_alignment_undoes_a_similarity(dx, dy, angle, log_scale):
    target = flat()
    moved = apply_similarity(target, Similarity(dx, dy, angle, log_scale))
    result = aligned_error(moved, target)
    assert result.unaligned == pytest.approx(squared_error(moved, target))
    # Two resamplings blur the edges: 600 px of outline of 9216 at a quarter each leave about 0.01.
    assert result.mse < 0.015


def test_alignment_never_makes_it_worse():
    rng = np.random.default_rng(0)
    image, target = rng.random((40, 30)), flat(40)[:, :30]
    result = aligned_error(image, target)
    assert result.mse <= result.unaligned


def test_an_empty_map_is_not_aligned():
    result = aligned_error(np.zeros((20, 20)), flat(96)[:20, :20] + 1.0)
    assert result.mse == result.unaligned


class TestWalls:
    def test_a_shift_within_the_tolerance_is_forgiven(self):
        walls = np.zeros((30, 30), bool)
        walls[10, 5:25] = True
        moved = np.roll(walls, 2, axis=0)
        assert wall_score(moved, walls, 2.0).f1 == 1.0
        assert wall_score(moved, walls, 1.0).f1 == 0.0

    def test_precision_and_recall_distinguish_surplus_from_missing(self):
        walls = np.zeros((30, 30), bool)
        walls[10, 5:25] = True
        half = walls.copy()
        half[10, 15:] = False
        score = wall_score(half, walls, 0.0)
        assert (score.precision, score.recall) == (1.0, 0.5)

    def test_two_empty_maps_agree_and_one_empty_map_does_not(self):
        none, some = np.zeros((5, 5), bool), np.eye(5, dtype=bool)
        assert wall_score(none, none).f1 == 1.0
        assert wall_score(none, some).f1 == 0.0

    def test_shapes_must_agree(self):
        with pytest.raises(ValueError, match="different shapes"):
            wall_score(np.zeros((2, 2), bool), np.zeros((2, 3), bool))


@settings(max_examples=40)
@given(
    st.tuples(st.integers(3, 40), st.integers(3, 40)),
    st.floats(-1.2, 1.2),
    st.floats(-1.2, 1.2),
    st.floats(-3.2, 3.2),
    st.floats(-0.8, 0.8),
)
def test_the_search_kernel_agrees_with_drawing_the_moved_image(shape, dx, dy, angle, log_scale):
    rng = np.random.default_rng(shape[0])
    image, target = rng.random((2, *shape)).astype(np.float32)
    similarity = Similarity(dx, dy, angle, log_scale)
    drawn = apply_similarity(image.astype(np.float64), similarity)
    error = moved_error(np.pad(image, 1), target, 0.0, 0.0, *similarity)
    # OpenCV interpolates at 32 steps a pixel: white noise then differs by up to 1/64 of its slope.
    assert error == pytest.approx(squared_error(drawn, target.astype(np.float64)), abs=0.02)


def test_a_map_is_aligned_with_itself():
    result = aligned_error(flat(), flat())
    assert (result.mse, result.unaligned, result.similarity) == (
        0.0,
        0.0,
        Similarity(0.0, 0.0, 0.0, 0.0),
    )


def test_alignment_finds_the_rotation_and_scale():
    target = np.pad(flat(), 48)  # room enough that the moved flat isn't cut off
    moved = apply_similarity(target, Similarity(0.04, -0.03, 2.0, 0.1))
    found = aligned_error(moved, target).similarity
    # Undoing a turn undoes it about the image's centre: angle and scale are those of the inverse.
    assert found.angle == pytest.approx(-2.0, abs=0.01)
    assert found.log_scale == pytest.approx(-0.1, abs=0.01)
