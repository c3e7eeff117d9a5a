"""Loops: a place that looks like another is not tied to it, nor one that the path leaves out."""

from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slamgym.core.types import LaserGeometry
from slamgym.sim.raycast import cast_rays
from slamgym.slam.config import PoseGraphConfig
from slamgym.slam.graph import closures
from slamgym.slam.graph.alignment import AlignmentTarget
from slamgym.slam.graph.closures import LoopCloser, agree
from slamgym.slam.graph.relative import (
    DAMPING,
    MATCH_FLOOR,
    WEAK,
    Match,
    moved_by,
    relative_covariance,
    seen_from,
    step_covariance,
    turned_matrix,
    weigh_match,
)
from slamgym.slam.graph.sight import Sight
from slamgym.slam.graph.submaps import Submap, oriented

numbers = st.tuples(*[st.floats(-3.0, 3.0)] * 3)


@given(numbers, numbers)
def test_what_is_seen_from_a_pose_lies_there_again(frame, pose):
    frame, pose = np.array(frame), np.array(pose)
    assert moved_by(frame, seen_from(frame, pose)) == pytest.approx(pose)
    # Two poses that are known relative to each other, and no better than one place with the other.
    cov, motion = np.diag([0.1, 0.2, 0.05]), pose[:2] - frame[:2]
    lever = np.array([[1.0, 0.0, -motion[1]], [0.0, 1.0, motion[0]], [0.0, 0.0, 1.0]])
    rigid = relative_covariance(frame, pose, cov, lever @ cov @ lever.T, cov @ lever.T)
    assert rigid == pytest.approx(np.zeros((3, 3)), abs=1e-9)


@given(st.integers(0, 1000), st.floats(-3.0, 3.0), st.integers(1, 4))
def test_what_a_submap_binds_is_weighed_as_by_numpy(seed, heading, count):
    rows = np.random.default_rng(seed).normal(0.0, 100.0, (6, 4))
    sums, own = rows.T @ rows, np.eye(3)
    shift, information = weigh_match(sums, heading, count, WEAK)
    known = sums[:3, :3]
    assert shift == pytest.approx(
        np.linalg.solve(known + DAMPING * own, sums[:3, 3]), rel=1e-6, abs=1e-9
    )
    spread, axes = np.linalg.eigh(known)
    weaker = axes @ np.diag(spread**2 / (spread + WEAK)) @ axes.T
    covariance = np.linalg.inv(turned_matrix(weaker, -heading) + own)
    expected = np.linalg.inv(covariance + count * np.diag(np.square(MATCH_FLOOR)))
    assert information == pytest.approx(expected, rel=1e-5, abs=1e-3)


NICHE, TWIN = [-0.6, 0.4, 1.5], [1.9, 2.9, 4.0]
"""Places of pairs of pillars [m]."""


class Path(NamedTuple):
    """Of a graph, what a loop closer asks."""

    poses: np.ndarray
    driven: np.ndarray
    deviation: float
    way = 99.0
    optimised = 1

    def relative_covariance(self, old: int) -> np.ndarray:
        return np.diag([self.deviation**2, 0.16, 0.0025])  # more across the corridor

    def is_tied(self, old: int) -> bool:
        return False

    def __len__(self) -> int:
        return len(self.poses)


LASER = LaserGeometry(181, np.radians(-90.0), np.radians(1.0), 0.1, 3.0)


def draw(submap: Submap, pose: np.ndarray, x: float, pillars: list[float]) -> np.ndarray:
    """Draw at a pose what is seen at ``x`` in a corridor with a pair of pillars at each of these distances.

    Returns:
        The ranges (181,) [m].
    """
    sides = [(p, side, p + 0.2, side * 0.6) for p in pillars for side in (-1, 1)]
    segments = np.array([(-30, -1, 30, -1), (-30, 1, 30, 1), *sides], dtype=np.float64)
    ranges, angles = np.empty(181), np.radians(np.arange(-90, 91))
    cast_rays(x, 0.0, 0.0, angles[0], np.pi / 180, segments, 3.0, ranges)
    seen = np.isfinite(ranges)
    points = ranges[seen, None] * np.column_stack([np.cos(angles), np.sin(angles)])[seen]
    submap.add(pose, oriented(points, np.zeros(2)))
    return ranges.astype(np.float32)


def closed(
    pillars: list[float],
    driven: float,
    deviation: float = 0.6,
    others: tuple[Match, ...] = (),
    new_pillars: list[float] = NICHE,
    *,
    in_sight: bool = True,
) -> Match | None:
    """The closure found when the robot, back at the place it began at, believes to be 0.9 m further.

    Args:
        pillars: Places of pairs of pillars [m].
        driven: Way since the beginning [m].
        deviation: Standard deviation along the corridor [m].
        others: Closures that were found before.
        new_pillars: Places of pairs of pillars that are seen now [m].
        in_sight: False if the scans at the beginning say nothing of what they saw through.
    """
    xs = np.arange(-1.0, 4.01, 0.25)
    old, new = Submap(0, 12.0), Submap(len(xs), 12.0)
    seen = [draw(old, np.array([x - xs[0], 0.0, 0.0]), x, pillars) for x in xs]
    seen.append(draw(new, np.zeros(3), 0.0, new_pillars))
    ranges = np.array(seen) if in_sight else np.zeros((len(seen), 181), np.float32)
    poses = np.array([(x, 0.0, 0.0) for x in [*xs, 0.9]])
    ways, submaps = np.array([*xs + 1.0, driven]), [old, new]

    def choose(numbers: list[int]) -> AlignmentTarget:
        chosen = [submaps[number] for number in numbers]
        return AlignmentTarget(chosen, poses[[submap.first for submap in chosen]])

    sight, graph = Sight(LASER, LASER.range_max), Path(poses, ways, deviation)
    closer = LoopCloser(PoseGraphConfig(), sight, graph, submaps, choose)
    closer.found = list(others)
    return closer.close(ranges)


def test_a_place_seen_again_closes_a_loop():
    match = closed(NICHE, 40.0)
    assert match is not None
    assert (match.old, match.new) == (0, 21)
    assert match.measured == pytest.approx([1.0, 0.0, 0.0], abs=0.02)


def test_of_two_places_that_fit_alike_none_is_taken():
    assert closed([*NICHE, *TWIN], 40.0) is None


def test_what_is_new_counts_against_a_place_only_where_that_was_in_sight(monkeypatch):
    monkeypatch.setattr(closures, "CLOSURE_FIT", 0.9)
    monkeypatch.setattr(closures, "SCORE_SHORTFALL", 0.5)
    changed = [*NICHE, 2.0, 2.5]
    assert closed(NICHE, 40.0, new_pillars=changed) is None
    assert closed(NICHE, 40.0, new_pillars=changed, in_sight=False) is not None


def test_a_place_left_a_moment_ago_is_not_seen_again():
    assert closed(NICHE, 4.9) is None


def test_a_place_that_the_path_leaves_out_is_another_that_looks_alike():
    assert closed(NICHE, 40.0, deviation=0.16) is None


def test_a_surprising_closure_needs_another_that_says_the_same():
    """0.9 m are 3.1 standard deviations of the path, the search's own window included."""
    surprising = 0.25
    assert closed(NICHE, 40.0, surprising) is None
    # Some metres before, and as far off the path; after 40 m it says nothing any more.
    before = Match(0, 14, np.array([3.5 - 0.9, 0.0, 0.0]), np.eye(3))
    assert closed(NICHE, 7.0, surprising, (before,)) is not None
    elsewhere = before._replace(measured=before.measured + np.array([1.0, 0.0, 0.0]))
    assert closed(NICHE, 7.0, surprising, (elsewhere,)) is None
    assert closed(NICHE, 40.0, surprising, (before,)) is None


def test_a_closure_that_surprises_more_needs_others_at_several_places():
    """0.9 m are 5 standard deviations of the path, the search's own window included."""
    surprising = 0.1
    before = Match(0, 14, np.array([3.5 - 0.9, 0.0, 0.0]), np.eye(3))
    again = Match(0, 15, np.array([3.75 - 0.9, 0.0, 0.0]), np.eye(3))
    further = Match(4, 15, np.array([2.75 - 0.9, 0.0, 0.0]), np.eye(3))
    assert closed(NICHE, 7.0, surprising, (before, again)) is None
    assert closed(NICHE, 7.0, surprising, (before, further)) is not None


@given(numbers, numbers, numbers, st.floats(0.1, 5.0), st.floats(-3.0, 3.0))
def test_closures_agree_if_they_move_the_path_alike(old, new, correction, apart, turn):
    """Whatever the correction, and wherever the frames are: the way between two closures stays as it was."""
    step = np.array([apart, 0.2, turn])
    first_old, first_new = np.array(old), np.array(new)
    second_old, second_new = moved_by(first_old, step), moved_by(first_new, step)
    poses = np.array([first_old, second_old, first_new, second_new])
    path = Path(poses, np.array([0.0, apart, 50.0, 50.0 + apart]), 0.4)
    true_new = moved_by(np.array(correction), first_new), moved_by(np.array(correction), second_new)
    closure = Match(0, 2, seen_from(first_old, true_new[0]), np.eye(3))
    other = Match(1, 3, seen_from(second_old, true_new[1]), np.eye(3))
    assert agree(path, closure, other)
    assert agree(path, other, closure)
    off = other._replace(measured=other.measured + np.array([0.0, 2.0, 0.0]))
    assert not agree(path, closure, off)
    turned = other._replace(measured=other.measured + np.array([0.0, 0.0, 0.5]))
    assert not agree(path, closure, turned)


def test_a_heading_error_moves_what_lies_ahead_sideways():
    covariance = step_covariance(np.array([2.0, 0.0]), np.diag([0.0, 0.0, 0.01]), np.zeros((3, 3)))
    assert covariance[1, 1] == pytest.approx(0.04)
    assert covariance[0, 0] == pytest.approx(0.0)


@given(numbers, st.integers(0, 1000))
def test_a_steps_covariance_is_that_of_poses_drawn_before_it(motion, seed):
    """To first order: small deviations of the start, carried through the step as poses are."""
    motion, start = np.array(motion), np.array([0.4, -0.2, 0.7])
    axes = np.random.default_rng(seed).normal(0.0, 1.0, (3, 3))
    added, eps = np.diag([0.01, 0.02, 0.003]), 1e-6
    ahead = seen_from(start, start + motion)
    moved = [moved_by(start + eps * axis, ahead) - moved_by(start, ahead) for axis in axes]
    carried = (
        np.array([(*way[:2], axis[2] * eps) for way, axis in zip(moved, axes, strict=True)]) / eps
    )
    covariance = step_covariance(motion[:2], axes.T @ axes, added)
    assert covariance == pytest.approx(carried.T @ carried + added, abs=1e-3)
