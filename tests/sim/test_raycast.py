import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgym.sim import cast_rays
from slamgym.sim.raycast import cast_hits, next_hit

DEGREE = math.radians(1)

coordinate = st.floats(-4, 4).map(lambda value: round(value, 3))
segment = st.tuples(coordinate, coordinate, coordinate, coordinate)


def cast(
    segments,
    *,
    pose=(0.0, 0.0, 0.0),
    angle_min=-math.pi,
    increment=DEGREE,
    beams=360,
    range_max=10.0,
):
    out = np.full(beams, -7.0)
    cast_rays(*pose, angle_min, increment, np.asarray(segments, dtype=float), range_max, out)
    return out


def brute_force(segments, pose, angles, range_max, lengthen):
    """Every beam against every wall, walls lengthened at both ends (or shortened, if negative)."""
    nearest = np.full(len(angles), np.inf)
    directions = np.column_stack([np.cos(pose[2] + angles), np.sin(pose[2] + angles)])
    for x0, y0, x1, y1 in segments:
        start = np.array([x0 - pose[0], y0 - pose[1]])
        along = np.array([x1 - x0, y1 - y0])
        length = np.hypot(*along)
        if length == 0.0:
            continue
        slant = directions[:, 0] * along[1] - directions[:, 1] * along[0]
        with np.errstate(all="ignore"):
            distance = (start[0] * along[1] - start[1] * along[0]) / slant
            at = (start[0] * directions[:, 1] - start[1] * directions[:, 0]) / slant * length
        hit = (
            (at >= -lengthen)
            & (at <= length + lengthen)
            & (distance >= 0)
            & (abs(slant) > 1e-6 * length)
        )
        nearest[hit] = np.minimum(nearest[hit], distance[hit])
    return np.where(nearest <= range_max, nearest, np.inf)


@given(
    st.lists(segment, min_size=1, max_size=8),
    st.tuples(coordinate, coordinate, st.floats(-7, 7)),
    st.sampled_from(
        [(-math.pi, 2 * math.pi / 360, 360), (-math.pi / 2, math.pi / 179, 180), (0.3, 0.05, 50)]
    ),
)
@settings(max_examples=400)
def test_ranges_equal_brute_force(segments, pose, beams):
    angle_min, increment, number = beams
    ranges = cast(segments, pose=pose, angle_min=angle_min, increment=increment, beams=number)
    angles = angle_min + increment * np.arange(number)
    # Whether a beam meets the very end of a wall is rounding: a hair more or less of wall must enclose the
    # answer. Walls seen more nearly edge-on than 1e-5 rad are rounding too, and left out.
    shorter = brute_force(segments, pose, angles, 10.0, -1e-6)
    longer = brute_force(segments, pose, angles, 10.0, 1e-6)
    edge_on = _seen_edge_on(segments, pose, angles)
    assert (ranges[~edge_on] <= shorter[~edge_on] + 1e-6).all()
    assert (ranges[~edge_on] >= longer[~edge_on] - 1e-6).all()


def _seen_edge_on(segments, pose, angles):
    beams = np.zeros(len(angles), dtype=bool)
    for x0, y0, x1, y1 in segments:
        wall = math.atan2(y1 - y0, x1 - x0)
        beams |= abs(np.sin(pose[2] + angles - wall)) < 1e-5
        beams |= math.hypot(x1 - x0, y1 - y0) < 1e-2
        on_the_wall = abs((x1 - x0) * (y0 - pose[1]) - (y1 - y0) * (x0 - pose[0])) < 1e-4
        beams |= on_the_wall
    return beams


def test_distances_in_a_square_room_are_exact():
    room = [(-2, -2, 2, -2), (2, -2, 2, 2), (2, 2, -2, 2), (-2, 2, -2, -2)]
    angles = -math.pi + math.radians(1) * np.arange(360)
    expected = 2.0 / np.maximum(abs(np.cos(angles)), abs(np.sin(angles)))
    assert cast(room) == pytest.approx(expected, abs=1e-12)


@given(st.floats(-4, 4), st.integers(3, 40), st.floats(-0.7, 0.7), st.floats(-0.7, 0.7))
def test_no_beam_escapes_through_the_corners_of_a_closed_room(theta, corners, x, y):
    angles = np.linspace(0, 2 * np.pi, corners, endpoint=False)
    points = 3.0 * np.column_stack([np.cos(angles), np.sin(angles)])
    room = np.hstack([points, np.roll(points, -1, axis=0)])
    # Beams at the corners exactly, seen from the middle.
    aimed = cast(room, angle_min=0.0, increment=2 * np.pi / corners, beams=corners)
    assert aimed == pytest.approx(3.0, abs=1e-9)
    assert np.isfinite(cast(room, pose=(x, y, theta))).all()


@pytest.mark.parametrize("theta", [0.0, math.pi, -3.0, 3.0, 100.0, -100.0])
def test_a_wall_behind_is_seen_across_the_seam_of_a_full_turn(theta):
    wall_ahead_of_the_seam = [(-1.0, -1.0, -1.0, 1.0)]
    pose = (0.0, 0.0, theta)
    directions = theta - math.pi + math.radians(1) * np.arange(360)
    expected = np.cos(directions) < -math.cos(math.pi / 4) - 1e-9
    assert np.array_equal(
        np.isfinite(cast(wall_ahead_of_the_seam, pose=pose))[expected],
        np.ones(expected.sum(), bool),
    )
    assert np.isinf(cast(wall_ahead_of_the_seam, pose=pose)[np.cos(directions) > -0.7]).all()


def test_a_narrow_view_sees_nothing_behind_it():
    assert np.isinf(cast([(-1, -1, -1, 1)], angle_min=-0.5, increment=0.01, beams=101)).all()


def test_walls_beyond_the_range_are_not_seen():
    wall = [(3.0, -5.0, 3.0, 5.0)]
    ranges = cast(wall, range_max=3.5)
    angles = -math.pi + math.radians(1) * np.arange(360)
    visible = abs(angles) <= math.acos(3.0 / 3.5)
    assert np.array_equal(np.isfinite(ranges), visible)
    assert ranges[180] == 3.0


def test_an_edge_on_wall_is_met_at_its_near_end():
    assert cast([(1.0, 0.0, 2.0, 0.0)])[180] == 1.0
    assert cast([(2.0, 0.0, 1.0, 0.0)])[180] == 1.0


def test_a_sensor_on_a_wall_sees_nothing_but_the_wall():
    assert (cast([(-1.0, 0.0, 1.0, 0.0), (3.0, -1.0, 3.0, 1.0)]) == 0.0).all()


def test_a_point_like_wall_does_no_harm():
    ranges = cast([(1.0, 0.0, 1.0, 0.0), (2.0, -1.0, 2.0, 1.0)])
    assert np.isfinite(ranges[180])
    assert ranges[181] == pytest.approx(2.0 / math.cos(math.radians(1)))


def test_without_walls_there_is_no_return():
    assert np.isinf(cast(np.empty((0, 4)))).all()


def test_the_segment_of_each_hit_is_the_one_that_a_single_ray_meets():
    rng = np.random.default_rng(3)
    segments = rng.uniform(-4, 4, (12, 4))
    ranges, hits = np.empty(360), np.empty(360, dtype=np.int64)
    cast_hits(0.1, 0.2, 0.3, -math.pi, DEGREE, segments, 6.0, ranges, hits)
    assert ((hits < 0) == np.isinf(ranges)).all()
    for i in range(360):
        angle = 0.3 - math.pi + i * DEGREE
        distance, index = next_hit(0.1, 0.2, math.cos(angle), math.sin(angle), 0.0, segments, 6.0)
        assert distance == pytest.approx(ranges[i], abs=1e-9)
        assert index == hits[i]
