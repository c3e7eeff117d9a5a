"""Scans that take their time, against those that a laser at rest takes at once."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgym.core.geometry import compose, part_of
from slamgym.core.types import LaserGeometry, LaserScan, Pose2D
from slamgym.sim.raycast import cast_rays
from slamgym.slam.deskew import deskewed, deskewed_at_last_beam

CORNERS = [(-2.5, -2.0), (2.0, -2.0), (2.0, 0.5), (3.0, 1.5), (1.0, 2.5), (-2.5, 2.0)]
ROOM = np.array([(*a, *b) for a, b in zip(CORNERS, [*CORNERS[1:], CORNERS[0]], strict=True)])
HALF_TURN = LaserGeometry(
    180, -math.pi / 2, math.pi / 179, 0.1, 10.0, Pose2D(-0.06, 0.02, 0.1), 0.1 / 179
)
FULL_TURN = LaserGeometry(
    360, -math.pi, math.pi / 180, 0.1, 10.0, Pose2D(0.15, -0.1, -2.0), 0.2 / 359
)
GEOMETRIES = (HALF_TURN, FULL_TURN)
AT_REST = Pose2D(0.0, 0.0, 0.0)


def cast(geometry, pose, walls=ROOM, angle=None):
    """Ranges from the robot's pose; with an angle, of one beam there."""
    x, y, theta = compose(pose, geometry.mount)
    angles = geometry.angles if angle is None else np.array([angle])
    ranges = np.empty(len(angles))
    cast_rays(x, y, theta, angles[0], geometry.angle_increment, walls, geometry.range_max, ranges)
    return ranges


def swept(geometry, pose, motion, walls=ROOM):
    """What a laser measures whose robot moves from a pose on while it measures beam after beam."""
    last = geometry.num_beams - 1
    ranges = np.empty(geometry.num_beams, np.float32)
    for beam, angle in enumerate(geometry.angles):
        share = beam / last if geometry.time_increment > 0.0 else 1.0 - beam / last
        now = compose(pose, part_of(motion, share))
        ranges[beam] = cast(geometry, now, walls, angle)[0]
    return LaserScan(3.0, ranges, geometry, motion)


def errors_off_corners(scan, geometry, pose, walls=ROOM):
    """Differences [m] from the scan taken at once, where beams on either side see the same wall, not edge-on."""
    expected = cast(geometry, pose, walls)
    bend = np.abs(np.diff(1.0 / expected, n=2))  # next to none on a straight wall
    slope = np.abs(np.diff(expected)) / expected[:-1] / geometry.angle_increment
    plain = (bend < 1e-3) & (slope[1:] < 4.0) & (slope[:-1] < 4.0)
    straight = np.flatnonzero(plain[2:-2] & plain[1:-3] & plain[3:-1] & plain[:-4] & plain[4:]) + 3
    return np.abs(scan.ranges[straight] - expected[straight])


poses = st.builds(Pose2D, st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(-3.0, 3.0))
motions = st.builds(Pose2D, st.floats(-0.06, 0.06), st.floats(-0.01, 0.01), st.floats(-0.36, 0.36))


@settings(max_examples=40, deadline=None)
@given(st.sampled_from(GEOMETRIES), poses, motions)
def test_a_swept_scan_becomes_the_one_that_is_taken_at_once(geometry, pose, motion):
    scan = swept(geometry, pose, motion)
    errors = errors_off_corners(deskewed(scan), geometry, pose)
    known = errors[~np.isnan(errors)]
    # A wall is a straight line between two returns; 1 cm is what is left beside a corner.
    assert known.max() < 0.01
    # Turning right it sees less of the room, on the side of its last beams.
    unseen = max(0.0, -motion.theta) / geometry.angle_increment
    assert len(errors) - len(known) <= unseen + 12


@pytest.mark.parametrize("turn", [0.36, -0.36])
@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_it_matters(geometry, turn):
    scan = swept(geometry, AT_REST, Pose2D(0.04, 0.0, turn))
    assert errors_off_corners(scan, geometry, AT_REST).max() > 0.2
    assert np.nanmax(errors_off_corners(deskewed(scan), geometry, AT_REST)) < 0.01


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_it_can_be_seen_from_where_the_robot_is_at_the_last_beam(geometry):
    motion = Pose2D(0.04, 0.01, 0.3)
    scan = deskewed_at_last_beam(swept(geometry, AT_REST, motion))
    assert scan.stamp == pytest.approx(3.0 + geometry.scan_time)
    assert np.nanmax(errors_off_corners(scan, geometry, motion)) < 0.01
    at_once = LaserScan(0.0, scan.ranges, geometry)
    assert deskewed_at_last_beam(at_once) is at_once


def test_a_laser_upside_down_measures_its_last_beam_first():
    geometry = HALF_TURN._replace(time_increment=-HALF_TURN.time_increment)
    scan = swept(geometry, AT_REST, Pose2D(0.03, 0.0, 0.3))
    assert np.nanmax(errors_off_corners(deskewed(scan), geometry, AT_REST)) < 0.01
    forwards = replace(scan, geometry=HALF_TURN)
    assert np.nanmax(errors_off_corners(deskewed(forwards), HALF_TURN, AT_REST)) > 0.2


def test_what_is_taken_at_once_or_at_rest_stays_the_same_object():
    moving = Pose2D(0.1, 0.0, 0.3)
    at_rest = LaserScan(0.0, np.ones(180, np.float32), HALF_TURN)
    at_once = LaserScan(
        0.0, np.ones(180, np.float32), HALF_TURN._replace(time_increment=0.0), moving
    )
    assert deskewed(at_rest) is at_rest
    assert deskewed(at_once) is at_once
    assert deskewed(at_rest, moving) is not at_rest


def test_it_is_a_scan_at_the_stamp_that_needs_nothing_more():
    scan = deskewed(swept(HALF_TURN, AT_REST, Pose2D(0.0, 0.0, 0.2)))
    assert (scan.stamp, scan.motion, scan.geometry.time_increment) == (3.0, AT_REST, 0.0)
    assert deskewed(scan) is scan


@pytest.mark.parametrize("turn", [0.3, -0.3])
def test_beams_without_return_stay_so_in_their_turned_direction(turn):
    ranges = np.full(180, 2.0, np.float32)
    ranges[100:120] = np.inf
    scan = deskewed(LaserScan(0.0, ranges, HALF_TURN, Pose2D(0.0, 0.0, turn)))
    turned = turn * 110 / 179 / HALF_TURN.angle_increment
    gap = np.flatnonzero(np.isposinf(scan.ranges))
    assert gap.mean() == pytest.approx(109.5 + turned, abs=1.0)
    width = 20 * (1.0 + turn / math.pi)  # stretched where the robot turns with the beams
    assert len(gap) == pytest.approx(width, abs=1.0)


def test_what_nobody_measured_is_unknown():
    ranges = np.full(180, 2.0, np.float32)
    ranges[50:60] = np.nan
    right = deskewed(LaserScan(0.0, ranges, HALF_TURN, Pose2D(0.0, 0.0, -0.3))).ranges
    first_unseen = 179 - round(0.3 / HALF_TURN.angle_increment) + 1
    assert np.isnan(right[first_unseen:]).all()
    inside = np.flatnonzero(np.isnan(right[:first_unseen]))
    assert 7 <= len(inside) <= 10
    assert not np.isinf(right).any()
    assert np.isnan(
        deskewed(
            LaserScan(0.0, np.full(180, np.nan, np.float32), HALF_TURN, Pose2D(0, 0, 1))
        ).ranges
    ).all()


def test_the_nearest_return_wins_where_two_fall_on_one_direction():
    # A full turn that ends where it began, and a quarter of a turn further.
    near_end = np.full(360, 3.0, np.float32)
    near_end[340:] = 1.0
    mount = Pose2D(0.0, 0.0, 0.0)
    geometry = FULL_TURN._replace(mount=mount)
    scan = deskewed(LaserScan(0.0, near_end, geometry, Pose2D(0.0, 0.0, 0.4)))
    beams_over = round(0.4 / geometry.angle_increment)
    assert scan.ranges[5 : beams_over - 5] == pytest.approx(1.0, abs=0.01)
    assert scan.ranges[beams_over + 5 : 300] == pytest.approx(3.0, abs=0.01)


def test_an_edge_stays_an_edge():
    """A wall behind a pillar isn't joined to it: nothing is invented between them."""
    pillar = np.array([(1.0, -0.2, 1.0, 0.2), (3.0, -9.0, 3.0, 9.0)])
    scan = deskewed(swept(HALF_TURN, AT_REST, Pose2D(0.03, 0.0, 0.25), pillar))
    x = scan.ranges * np.cos(HALF_TURN.angles + 0.1) - 0.06
    ahead = np.abs(HALF_TURN.angles + 0.1) < 0.8
    on_surface = np.minimum(np.abs(x - 1.0), np.abs(x - 3.0))
    assert np.nanmax(on_surface[ahead]) < 0.02
