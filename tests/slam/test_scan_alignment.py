import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgym.sim.raycast import cast_rays
from slamgym.slam.graph.config import PoseGraphConfig
from slamgym.slam.graph.matching import NodeMatcher

ROOM = np.array(
    [(-4, -3, 5, -3), (5, -3, 5, 2), (5, 2, 1, 2), (1, 2, 1, 4), (1, 4, -4, 4), (-4, 4, -4, -3),
     (2, -1, 3, -1), (3, -1, 3, 0), (3, 0, 2, 0), (2, 0, 2, -1)], dtype=np.float64,
)  # fmt: skip
CORRIDOR = np.array([(-100, -1, 100, -1), (-100, 1, 100, 1)], dtype=np.float64)
BEAMS = 181


def scan_points(pose, segments=ROOM, range_max=20.0):
    """End points in the robot frame of an exact scan over half a turn."""
    ranges = np.empty(BEAMS)
    cast_rays(*pose, -np.pi / 2, np.pi / 180, segments, range_max, ranges)
    angles = -np.pi / 2 + np.radians(np.arange(BEAMS))
    hit = np.isfinite(ranges)
    return ranges[hit, None] * np.column_stack([np.cos(angles), np.sin(angles)])[hit]


def local_map(matcher, poses, segments=ROOM):
    scans = [scan_points(pose, segments) for pose in poses]
    points, counts = np.zeros((len(scans), BEAMS, 2)), np.array([len(scan) for scan in scans])
    for k, scan in enumerate(scans):
        points[k, : len(scan)] = scan
    return matcher.local_map(points, counts, np.arange(len(scans)), np.array(poses), np.zeros(3), 12.0)


KNOWN = [(-1.0, 0.0, 0.0), (-0.5, 0.2, 1.5), (0.0, 0.0, 3.0), (0.3, -0.3, -1.5)]


@settings(deadline=None, max_examples=25)
@given(st.floats(-0.8, 0.8), st.floats(-0.8, 0.8), st.floats(-0.35, 0.35))
def test_search_and_alignment_find_the_pose_to_a_centimetre(dx, dy, turn):
    matcher = NodeMatcher(PoseGraphConfig())
    room = local_map(matcher, KNOWN)
    truth = np.array([0.1, 0.2, 0.4])
    points = scan_points(truth)
    start, score = matcher.search(room, points, truth + np.array([dx, dy, turn]), 1.0, 0.4, 0.3)
    assert score > 0.6
    match = matcher.align(room, points, start, start, np.zeros((3, 3)))
    assert match.fit > 0.8
    assert np.abs(match.pose - truth)[:2].max() < 0.01
    assert abs(match.pose[2] - truth[2]) < 0.005


def test_a_place_outside_the_window_is_not_found():
    matcher = NodeMatcher(PoseGraphConfig())
    room = local_map(matcher, KNOWN)
    _, score = matcher.search(room, scan_points((0.1, 0.2, 0.4)), np.array([4.0, 0.2, 2.0]), 0.3, 0.1, 0.7)
    assert score <= 0.7


def test_a_corridor_leaves_the_scan_free_to_slide():
    matcher = NodeMatcher(PoseGraphConfig())
    corridor = local_map(matcher, [(0.0, 0.0, 0.0), (0.5, 0.0, 0.0)], CORRIDOR)
    here = np.array([0.2, 0.05, 0.0])
    match = matcher.align(corridor, scan_points(here, CORRIDOR), here, here, np.zeros((3, 3)))
    assert abs(match.pose[1] - 0.05) < 0.01
    along, across = match.information[0, 0], match.information[1, 1]
    assert across > 50.0 * along


def test_branch_and_bound_finds_what_brute_force_finds():
    from slamgym.slam.graph.matching import CellIndex, block_score, paint_levels, search_window

    rng = np.random.default_rng(0)
    for _ in range(5):
        index = np.where(rng.random((40, 50)) < 0.05, 1, -1).astype(np.int32)
        points = rng.uniform(-1.5, 1.5, (25, 2))
        centre, angles = np.array([2.5, 2.0, 0.3]), np.array([-0.2, 0.0, 0.2])
        levels = np.empty((4, 40, 50), np.uint8)
        paint_levels(index, levels)
        pose = np.empty(3)
        found = search_window(levels, CellIndex(index, 0.0, 0.0, 0.1), points, centre, 7, angles, 0.0, pose)
        best = 0
        for angle in angles:
            c, s = np.cos(0.3 + angle), np.sin(0.3 + angle)
            u = np.floor((2.5 + c * points[:, 0] - s * points[:, 1]) / 0.1).astype(np.int32)
            v = np.floor((2.0 + s * points[:, 0] + c * points[:, 1]) / 0.1).astype(np.int32)
            for du in range(-7, 8):
                for dv in range(-7, 8):
                    best = max(best, block_score(levels[0], 1, u, v, du, dv))
        assert found == pytest.approx(best / (255 * 25))
