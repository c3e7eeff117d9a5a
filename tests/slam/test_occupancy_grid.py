"""Scans drawn into counts: the same from all four sides, wherever the map lies, and undone without a trace."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, LaserGeometry, Pose2D
from slamgym.slam.config import SlamConfig
from slamgym.slam.hit_count_kernels import (
    BeamTable,
    classify_counts,
    draw_scans,
    draw_scans_once,
    drawn_lengths,
    regrid,
)
from slamgym.slam.hit_counts import HitCountMap

HALF, CELL = 120, 0.05
BEAMS = BeamTable.of(
    LaserGeometry(90, -np.pi / 2, np.pi / 90, 0.12, 3.5, Pose2D(-0.06, 0.02, 0.3)), SlamConfig()
)


def draw(poses, ranges, counts=None, sign=1):
    """Counts of a square round the origin, row 0 at the bottom."""
    counts = np.zeros((2 * HALF, 2 * HALF, 2), np.int32) if counts is None else counts
    bounds = draw_scans(counts, (-HALF, -HALF), CELL, np.atleast_2d(poses), ranges, BEAMS, sign)
    assert np.abs(bounds).max() < HALF * CELL  # else nothing would have been drawn
    return counts


def scans(seed, number):
    """Poses and ranges, among them every kind of beam that is left out or cut."""
    rng = np.random.default_rng(seed)
    poses = rng.uniform([-2.0, -2.0, -np.pi], [2.0, 2.0, np.pi], (number, 3))
    ranges = rng.uniform(0.05, 4.0, (number, 90)).astype(np.float32)
    ranges[:, 60:70], ranges[:, 75], ranges[:, 80] = np.inf, np.nan, -np.inf
    return poses, ranges


seeds = st.integers(0, 2**32 - 1)


@settings(max_examples=30)
@given(seeds)
def test_a_quarter_turn_of_the_world_turns_the_map(seed):
    poses, ranges = scans(seed, 3)
    turned = np.column_stack([-poses[:, 1], poses[:, 0], poses[:, 2] + np.pi / 2])
    # Row 0 is at the bottom: a turn to the left is numpy's to the right.
    np.testing.assert_array_equal(draw(turned, ranges), np.rot90(draw(poses, ranges), k=-1))


@settings(max_examples=30)
@given(seeds)
def test_what_is_drawn_and_taken_out_leaves_nothing(seed):
    (stays, kept), (goes, ranges) = scans(seed, 2), scans(seed + 1, 3)
    counts = draw(stays, kept)
    before = counts.copy()
    draw(goes, ranges, counts)
    assert (counts >= before).all()
    draw(goes[::-1].copy(), ranges[::-1].copy(), counts, sign=-1)
    np.testing.assert_array_equal(counts, before)


@settings(max_examples=30)
@given(seeds)
def test_hits_are_visits_and_each_return_within_reach_is_one_hit(seed):
    poses, ranges = scans(seed, 2)
    counts = draw(poses, ranges)
    assert (counts[..., 0] <= counts[..., 1]).all()
    within = (ranges >= BEAMS.range_min) & (ranges <= BEAMS.usable)
    assert counts[..., 0].sum() == within.sum()


def test_a_lone_beam_clears_its_way_and_hits_its_end():
    ranges = np.full((1, 90), np.nan, np.float32)
    ranges[0, 45] = 1.0
    pose = np.array(
        [[0.06, -0.02, -0.3]]
    )  # the sensor at the origin but for the mount's turn, beams ahead
    cells = np.empty((2 * HALF, 2 * HALF), np.uint8)
    classify_counts(draw(pose, ranges), (0, 0, *cells.shape), 0.25, (0.0, 0.0), 1, cells)
    assert np.count_nonzero(cells == OCCUPIED) == 1
    (row,), (col,) = np.nonzero(cells == OCCUPIED)
    assert np.hypot(row - HALF, col - HALF) * CELL == pytest.approx(1.0, abs=0.1)
    assert 15 <= np.count_nonzero(cells == FREE) <= 21
    assert cells[HALF, HALF] == FREE


@settings(max_examples=20)
@given(seeds)
def test_a_scan_that_counts_a_cell_once_counts_a_hit_before_a_visit(seed):
    poses, ranges = scans(seed, 3)
    once = np.zeros((2 * HALF, 2 * HALF, 2), np.int32)
    draw_scans_once(once, (-HALF, -HALF), CELL, poses, ranges, BEAMS, 1)
    singly = [draw(pose, scan[None]) for pose, scan in zip(poses, ranges, strict=True)]
    np.testing.assert_array_equal(once, sum((counts > 0).astype(np.int32) for counts in singly))
    draw_scans_once(once, (-HALF, -HALF), CELL, poses, ranges, BEAMS, -1)
    assert not once.any()


def test_nothing_of_several_scans_is_drawn_once_if_one_reaches_out_of_the_grid():
    poses, ranges = scans(0, 2)
    poses[1, 0] += 2 * HALF * CELL
    counts = np.zeros((2 * HALF, 2 * HALF, 2), np.int32)
    bounds = draw_scans_once(counts, (-HALF, -HALF), CELL, poses, ranges, BEAMS, 1)
    assert bounds[2] > HALF * CELL
    assert not counts.any()


def test_between_the_margins_a_saved_map_is_unknown_but_not_the_one_to_drive_by():
    counts = np.zeros((1, 7, 2), np.int32)
    counts[0, :, 0], counts[0, :, 1] = (0, 0, 1, 3, 5, 6, 0), (10, 16, 10, 10, 10, 10, 0)
    cells = np.empty((1, 7), np.uint8)
    classify_counts(counts, (0, 0, 1, 7), 0.2, (3.0, 3.0), 1, cells)
    assert cells[0].tolist() == [UNKNOWN, FREE, UNKNOWN, UNKNOWN, UNKNOWN, OCCUPIED, UNKNOWN]
    poses, ranges = scans(1, 4)
    config = SlamConfig(occupied_margin=1.5, free_margin=0.5, counting="scans")
    plain, saved = HitCountMap(BEAMS, SlamConfig(counting="scans")), HitCountMap(BEAMS, config)
    for drawn in (plain, saved):
        drawn.draw(poses, ranges)
    frame = plain.occupancy_grid().frame
    np.testing.assert_array_equal(saved.render(frame), plain.render(frame))
    assert (saved.occupancy_grid().cells != UNKNOWN).sum() < (
        plain.occupancy_grid().cells != UNKNOWN
    ).sum()


@given(st.floats(0.3, 2.9), st.floats(-np.pi, np.pi))
def test_the_cells_of_a_ray_are_those_nearest_to_it(length, heading):
    ranges = np.full((1, 90), np.nan, np.float32)
    ranges[0, 45] = length
    counts = draw(np.array([[0.4, -0.3, heading]]), ranges)
    (end,) = np.argwhere(counts[..., 0])
    cells = np.argwhere(counts[..., 1])
    start = cells[np.argmax(np.abs(cells - end).max(axis=1))]
    major = int(np.argmax(np.abs(end - start)))
    way = end[major] - start[major]
    assert len(cells) == abs(way) + 1  # one cell in each row or column
    exact = start[1 - major] + (cells[:, major] - start[major]) * (end - start)[1 - major] / way
    assert np.abs(cells[:, 1 - major] - exact).max() <= 0.5 + 1e-6


@settings(max_examples=30)
@given(seeds, st.integers(1, 4), st.integers(-3, 3), st.integers(-3, 3))
def test_of_the_cells_in_a_coarse_one_occupied_wins_then_free(seed, ratio, left, bottom):
    cells = np.random.default_rng(seed).choice(
        np.array([OCCUPIED, FREE, UNKNOWN], np.uint8), (12, 24), p=[0.1, 0.3, 0.6]
    )
    out = np.empty((12 // ratio, 24 // ratio), np.uint8)
    regrid(cells, float(left), float(bottom), float(ratio), out)
    around = np.pad(cells, 3, constant_values=UNKNOWN)[3 + bottom :, 3 + left :]
    blocks = around[: out.shape[0] * ratio, : out.shape[1] * ratio]
    blocks = blocks.reshape(out.shape[0], ratio, out.shape[1], ratio).swapaxes(1, 2)
    expected = np.where((blocks == FREE).any(axis=(2, 3)), FREE, UNKNOWN)
    expected[(blocks == OCCUPIED).any(axis=(2, 3))] = OCCUPIED
    np.testing.assert_array_equal(
        out[::-1], expected
    )  # row 0 of what leaves the package is at the top


def test_who_looks_at_a_map_before_it_grows_changes_nothing():
    poses, ranges = scans(3, 2)
    far = poses + np.array([12.0, -9.0, 0.0])
    looked_at, other = HitCountMap(BEAMS, SlamConfig()), HitCountMap(BEAMS, SlamConfig())
    for drawn in (looked_at, other):
        drawn.draw(poses, ranges)
        if drawn is looked_at:
            drawn.occupancy_grid()
        drawn.draw(far, ranges)
    assert looked_at.occupancy_grid().frame == other.occupancy_grid().frame
    np.testing.assert_array_equal(looked_at.occupancy_grid().cells, other.occupancy_grid().cells)


@pytest.mark.parametrize("at_the_end", [True, False])
def test_a_gap_that_the_scan_cuts_off_is_open_if_it_is_wider_than_a_quarter_turn(at_the_end):
    geometry = LaserGeometry(91, -np.pi / 2, np.pi / 60, 0.12, 3.5)
    beams = BeamTable.of(geometry, SlamConfig())
    lengths = np.empty(91)
    for missing, open_length in ((30, 0.0), (31, beams.usable)):
        ranges = np.full(91, 2.0, np.float32)
        ranges[:missing] = np.inf
        drawn_lengths(ranges[::-1].copy() if at_the_end else ranges, beams, lengths)
        gap = lengths[-missing:] if at_the_end else lengths[:missing]
        assert gap == pytest.approx(np.full(missing, open_length))
