import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgym.sim import motion

# To the micrometre: of segments of 1e-270 m shapely knows no distance.
coordinate = st.floats(-5, 5).map(lambda value: round(value, 6))
segment = st.tuples(coordinate, coordinate, coordinate, coordinate)
NOBODY = np.empty((0, 3))


def state_at(x, y, theta):
    return np.array([x, y, theta, 0.0, 0.0, 0.0, 0.0, 0.0])


@given(coordinate, coordinate, st.lists(segment, min_size=1, max_size=5))
@settings(max_examples=200)
def test_clearance_is_the_distance_to_the_nearest_segment(x, y, segments):
    expected = min(
        shapely.LineString([s[:2], s[2:]]).distance(shapely.Point(x, y)) for s in segments
    )
    assert motion.clearance(x, y, np.array(segments), NOBODY) == pytest.approx(expected, abs=1e-9)


def test_clearance_counts_people_as_discs():
    wall = np.array([[5.0, -5.0, 5.0, 5.0]])
    assert motion.clearance(0.0, 0.0, wall, np.array([[3.0, 4.0, 0.25]])) == pytest.approx(4.75)
    assert motion.clearance(3.0, 4.0, wall, np.array([[3.0, 4.0, 0.25]])) == pytest.approx(-0.25)


@given(coordinate, coordinate)
@settings(max_examples=200)
def test_inside_follows_the_even_odd_rule_with_holes(x, y):
    ring = shapely.Polygon([(-4, -4), (4, -3), (3, 4), (-3, 3)], [[(-1, -1), (1, -1), (0, 2)]])
    rings = [np.asarray(r.coords) for r in (ring.exterior, *ring.interiors)]
    segments = np.vstack([np.hstack([r[:-1], r[1:]]) for r in rings])
    point = shapely.Point(x, y)
    if ring.boundary.distance(point) > 1e-9:
        assert motion.inside(x, y, segments) == ring.contains(point)


@given(st.floats(-2, 2), st.floats(-2, 2), st.floats(0.1, 5), st.floats(0.01, 3))
def test_a_ramp_is_the_integral_of_its_velocity(start, target, acceleration, span):
    mean, final = motion.ramp(start, target, acceleration, span)
    times = np.linspace(0, span, 20001)
    change = target - start
    velocity = start + np.sign(change) * np.minimum(acceleration * times, abs(change))
    assert final == pytest.approx(velocity[-1], abs=1e-9)
    # The trapezoidal rule is exact but for the one piece in which the ramp ends.
    assert mean * span == pytest.approx(
        np.trapezoid(velocity, times), abs=acceleration * (span / 20000) ** 2 + 1e-9
    )


@given(st.floats(-3, 3), st.floats(-1, 1), st.floats(-3, 3))
def test_a_chord_is_the_sum_of_many_small_steps(theta, way, turn):
    pieces = 2000
    headings = theta + turn * (np.arange(pieces) + 0.5) / pieces
    expected = way / pieces * np.array([np.cos(headings).sum(), np.sin(headings).sum()])
    # The midpoint rule errs by turn^2 / 24 n^2 of the distance.
    assert motion.chord(theta, way, turn) == pytest.approx(expected, abs=1e-6)


def test_the_ramp_is_fine_enough_to_leave_no_more_than_a_twentieth_of_a_millimetre():
    limits = np.array([2.5, 3.2, 0.287])
    nothing = np.array([[1e3, -1e3, 1e3, 1e3]])
    coarse, fine = state_at(0, 0, 0), state_at(0, 0, 0)
    motion.drive_freely(coarse, 0.26, 1.82, limits, 0.6, 0.2, nothing, NOBODY)
    for _ in range(6000):
        motion.drive_freely(fine, 0.26, 1.82, limits, 1e-4, 0.2, nothing, NOBODY)
    assert math.dist(coarse[:2], fine[:2]) < 5e-5
    assert coarse[2:] == pytest.approx(fine[2:], abs=1e-9)
