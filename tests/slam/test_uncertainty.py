"""The uncertainty of a path grows as it is driven, and falls where a loop is closed or mapped ground is met again."""

import math

import numpy as np
import pytest

from slamgym.slam.uncertainty import PathUncertainty, match_covariance, step_covariance

MATCH = np.diag([1e-4, 1e-4, 1e-5])


def straight(count: int) -> np.ndarray:
    return np.column_stack([0.5 * np.arange(count), np.zeros(count), np.zeros(count)])


def driven(
    poses: np.ndarray, view: float = 2.0 * math.pi, match=MATCH, revisits: bool = False
) -> PathUncertainty:
    path = PathUncertainty(view)
    before = poses[0]
    for pose in poses:
        path.move(before, pose, np.array([1e-3, 1e-4]))
        assert path.needs_node
        path.append(pose, match)
        if revisits:
            path.revisit(match)
        before = pose
    return path


def there_and_back(count: int = 20) -> np.ndarray:
    out = straight(count)
    back = out[::-1] + np.array([0.0, 0.1, np.pi])
    return np.vstack([out, back])


def position_variance(path: PathUncertainty) -> float:
    return float(np.trace(path.latest[:2, :2]))


def test_the_start_is_certain_and_what_follows_is_less_and_less():
    traces = [position_variance(driven(straight(count))) for count in range(1, 30)]
    assert traces[0] == 0.0
    assert (np.diff(traces) > 0.0).all()


def test_a_heading_error_moves_what_lies_ahead_sideways():
    covariance = step_covariance(np.array([2.0, 0.0]), np.diag([0.0, 0.0, 0.01]), np.zeros((3, 3)))
    assert covariance[1, 1] == pytest.approx(0.04)
    assert covariance[0, 0] == pytest.approx(0.0)


def test_between_nodes_the_uncertainty_grows_from_the_newest():
    path = driven(straight(5))
    path.move(np.array([2.0, 0.0, 0.0]), np.array([2.2, 0.0, 0.0]), np.array([1e-3, 1e-4]))
    assert not path.needs_node
    here = path.at(np.array([2.2, 0.0, 0.0]), None)
    assert np.trace(here[:2, :2]) > position_variance(path)
    assert path.at(np.array([2.2, 0.0, 0.0]), MATCH)[0, 0] < here[0, 0]


def test_a_corridor_is_uncertain_along_its_walls():
    # A thousandth of what the points bind across the walls, they bind along them.
    covariance = match_covariance(np.array([0.05, 0.0, 50.0, 0.0, 0.0, 100.0]))
    assert covariance[0, 0] > 100.0 * covariance[1, 1]
    path = driven(straight(10), match=covariance)
    assert path.latest[0, 0] > 2.0 * step_covariance(np.zeros(2), driven(straight(10)).latest, 0.0)[0, 0]


def test_a_closed_loop_makes_the_end_as_certain_as_the_place_it_came_back_to():
    poses = straight(40)
    poses[20:] = poses[19::-1]
    path = driven(np.vstack([poses[:20], poses[20:] + np.array([0.0, 0.0, 1.0])]))
    before = position_variance(path)
    path.follow(poses, [(3, 39, MATCH)])
    after = position_variance(path)
    assert after < 0.2 * before
    # Whatever the order in which the two nodes are named.
    path.follow(poses, [(39, 3, MATCH)])
    assert position_variance(path) == after


def test_mapped_ground_makes_a_filter_more_certain_again():
    grown, back = driven(there_and_back()), driven(there_and_back(), revisits=True)
    assert position_variance(back) < 0.5 * position_variance(grown)
    # The first node is certain; the match that finds it isn't.
    assert position_variance(back) > 2.0 * 0.03**2


def test_a_laser_that_looks_the_other_way_sees_no_mapped_ground():
    turned = driven(there_and_back(), view=np.pi / 2, revisits=True)
    assert position_variance(turned) == position_variance(driven(there_and_back()))


def test_who_does_not_know_where_he_is_is_not_back():
    vague = np.diag([0.05, 0.05, 0.01])
    path = PathUncertainty()
    poses = there_and_back()
    for before, pose in zip(poses[[0, *range(len(poses) - 1)]], poses, strict=True):
        path.move(before, pose, np.array([0.05, 0.01]))
        path.append(pose, vague)
        unsure = position_variance(path)
        path.revisit(MATCH)
        assert position_variance(path) == unsure or unsure < 0.3**2 + 0.05


def test_covariances_are_symmetric_and_positive():
    path = driven(there_and_back(), revisits=True)
    assert path.latest == pytest.approx(path.latest.T)
    assert (np.linalg.eigvalsh(path.latest) > 0.0).all()


def test_between_two_nodes_lies_what_was_added_on_the_way():
    path = driven(straight(20))
    np.testing.assert_allclose(path.between(0, 19), path.latest, rtol=1e-9)
    np.testing.assert_allclose(path.between(4, 4), 0.0)
    traces = [np.trace(path.between(old, 19)[:2, :2]) for old in range(20)]
    assert (np.diff(traces) < 0.0).all()
    # Seen from each other two nodes are equally uncertain, up to the lever that turns with them.
    assert path.between(3, 9)[2, 2] == pytest.approx(path.between(9, 3)[2, 2])


def test_far_from_the_start_two_neighbours_know_each_other_well():
    poses = there_and_back()
    path = driven(poses)
    path.follow(poses, [(19, 39, MATCH)])
    near = np.trace(path.between(18, 39)[:2, :2])
    assert near < 0.2 * np.trace(path.between(0, 39)[:2, :2])
    assert near > np.trace(path.between(19, 39)[:2, :2])
