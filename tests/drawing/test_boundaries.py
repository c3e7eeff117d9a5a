"""Candidates for boundaries: doors are among them, they turn with the floor, and none runs on along a wall."""

import numpy as np
import pytest
import shapely
from drawing.painted import DOOR, FLAT
from shapely import affinity

from slamgym.drawing.boundaries import candidate_lines
from slamgym.drawing.free_space import FreeSpace


def rounded(lines):
    """Lines as sets of two ends, to a millimetre."""
    return {
        frozenset((round(x, 3) + 0.0, round(y, 3) + 0.0) for x, y in line)
        for line in lines.tolist()
    }


def test_reach_is_the_way_to_the_next_edge():
    space = FreeSpace(shapely.box(0, 0, 4, 3).difference(shapely.box(1, 1, 2, 2)))
    ways = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, 1.0]])
    reach = space.reach(np.array([[0.5, 1.5], [0.5, 1.5], [0.5, 1.5], [1.5, 0.5]]), ways, 1.2)
    assert reach == pytest.approx([0.5, 0.5, 1.2, 0.5])


@pytest.mark.parametrize("turn", [0.0, 31.0])
def test_a_door_between_two_rooms_is_a_candidate(turn):
    lines = candidate_lines(FreeSpace(affinity.rotate(FLAT, turn, origin=(0, 0))))
    door = affinity.rotate(DOOR, turn, origin=(0, 0))
    within = [line for line in shapely.linestrings(lines) if door.buffer(1e-3).covers(line)]
    assert any(line.length == pytest.approx(0.9, abs=1e-3) for line in within)


def test_a_line_ends_at_the_other_jamb_though_its_face_lies_a_little_aside():
    """It would go on beside the wall."""
    rooms = [shapely.box(0, 0, 4, 5), shapely.box(4.1, 0, 8, 5), shapely.box(3.9, 2.2, 4.2, 3.1)]
    floor = shapely.union_all(rooms).difference(shapely.box(3.0, 3.1, 4.002, 5.0))
    for line in candidate_lines(FreeSpace(floor)):
        assert not (np.abs(line[:, 0] - 4.0) < 0.01).all() or abs(np.ptp(line[:, 1])) < 1.0


def test_turning_and_shifting_the_floor_turns_and_shifts_the_candidates():
    lines = candidate_lines(FreeSpace(FLAT))
    assert len(lines) >= 2
    moved = affinity.translate(affinity.rotate(FLAT, 90.0, origin=(0, 0)), 3.0, -2.0)
    expected = np.stack([3.0 - lines[..., 1], lines[..., 0] - 2.0], axis=-1)
    assert rounded(candidate_lines(FreeSpace(moved))) == rounded(expected)


def test_no_candidate_leaves_the_floor():
    floor = shapely.union_all([FLAT, shapely.box(7.3, 0.5, 7.4, 2.4), shapely.box(7.4, 0, 10, 4)])
    lines = shapely.linestrings(candidate_lines(FreeSpace(floor)))
    assert len(lines) > 4
    assert all(floor.buffer(0.021).covers(line) for line in lines)


def test_a_floor_without_corners_has_none():
    assert candidate_lines(FreeSpace(shapely.box(0, 0, 4, 3))).shape == (0, 2, 2)
