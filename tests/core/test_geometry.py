import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from slamgym.core.geometry import between, compose, inverse, transform_poses, wrap_angle
from slamgym.core.types import Pose2D

coordinates = st.floats(-1e3, 1e3)
angles = st.floats(-50.0, 50.0)
poses = st.builds(Pose2D, coordinates, coordinates, angles)

# Coordinates reach 1e3 m, so double precision leaves about 1e-13 * 1e3 after a few operations.
TOLERANCE = 1e-8


def assert_same_pose(a: Pose2D, b: Pose2D) -> None:
    assert math.isclose(a.x, b.x, abs_tol=TOLERANCE)
    assert math.isclose(a.y, b.y, abs_tol=TOLERANCE)
    assert abs(wrap_angle(a.theta - b.theta)) < TOLERANCE


@given(angles)
def test_wrapped_angles_lie_in_the_half_open_interval_and_keep_their_direction(angle):
    wrapped = wrap_angle(angle)
    assert -math.pi < wrapped <= math.pi
    assert math.isclose(math.cos(wrapped), math.cos(angle), abs_tol=TOLERANCE)
    assert math.isclose(math.sin(wrapped), math.sin(angle), abs_tol=TOLERANCE)


def test_both_signs_of_half_a_turn_become_plus_pi():
    assert wrap_angle(-math.pi) == math.pi
    assert wrap_angle(math.pi) == math.pi
    np.testing.assert_array_equal(wrap_angle(np.array([-math.pi, math.pi])), [math.pi, math.pi])


@given(poses)
def test_a_pose_and_its_inverse_cancel(pose):
    assert_same_pose(compose(pose, inverse(pose)), Pose2D(0.0, 0.0, 0.0))


@given(poses, poses, poses)
def test_composition_is_associative(a, b, c):
    assert_same_pose(compose(compose(a, b), c), compose(a, compose(b, c)))


@given(poses, poses)
def test_between_is_what_leads_from_one_pose_to_the_other(a, b):
    assert_same_pose(compose(a, between(a, b)), Pose2D(b.x, b.y, wrap_angle(b.theta)))


@given(poses, st.lists(poses, min_size=1, max_size=5))
def test_poses_are_transformed_as_by_composition(pose, others):
    moved = transform_poses(pose, np.array(others))
    for row, other in zip(moved, others, strict=True):
        assert_same_pose(Pose2D(*row), compose(pose, other))
