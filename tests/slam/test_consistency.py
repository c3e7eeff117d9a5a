"""The consistency on a map: rooms that were drawn twice are broken, the same room seen again is not."""

from types import SimpleNamespace

import numpy as np
import pytest

from slamgym.core.types import LaserGeometry, Pose2D
from slamgym.sim.raycast import cast_rays
from slamgym.slam.graph.consistency import (
    FEW_SEEN,
    LOST_FIT,
    MOST_SHARE,
    STRETCH_METRES,
    UNKNOWN_METRES,
    Consistency,
    are_broken,
)
from slamgym.slam.graph.submaps import Submap, oriented
from slamgym.slam.mapper import DoubtSpan, SlamStats

GEOMETRY = LaserGeometry(180, -np.pi, np.pi / 90, 0.1, 8.0, Pose2D(0.1, 0.0, 0.0))
ROOM = np.array(
    [(-2, -1.5, 2, -1.5), (2, -1.5, 2, 1.5), (2, 1.5, -2, 1.5), (-2, 1.5, -2, -1.5)],
    dtype=np.float64,
)
SCANS, SUBMAPS = 8, 6


def judged(offsets, deviation=0.0, fits=None):
    """A robot that stays in a room, with submaps drawn at offsets in x [m]; returns doubtful and broken scans."""
    ranges = np.empty(GEOMETRY.num_beams)
    cast_rays(0.1, 0.0, 0.0, GEOMETRY.angle_min, GEOMETRY.angle_increment, ROOM, 8.0, ranges)
    points = ranges[:, None] * np.column_stack(
        [np.cos(GEOMETRY.angles), np.sin(GEOMETRY.angles)]
    ) + (0.1, 0.0)
    seen, submaps = oriented(points, np.array([0.1, 0.0])), []
    for number in range(len(offsets)):
        submap = Submap(SCANS * number, 6.0)
        for _ in range(SCANS):
            submap.add(np.zeros(3), seen)
        submap.close()
        submaps.append(submap)
    poses = np.zeros((SCANS * len(offsets), 3))
    poses[:, 0] = np.repeat(offsets, SCANS)
    driven = np.arange(len(poses)) * STRETCH_METRES / SCANS
    graph = SimpleNamespace(
        poses=poses,
        driven=driven,
        deviation=lambda old, new: deviation if new - old == SCANS == new // 2 else 0.0,
    )
    consistency = Consistency(GEOMETRY)
    scans = np.tile(ranges.astype(np.float32), (len(poses), 1))
    for number in range(len(submaps)):
        consistency.judge(number, submaps, graph, scans)
    stamps = np.arange(len(poses), dtype=np.float64)
    return consistency.stamps(stamps, np.ones(len(poses)) if fits is None else fits)


def test_a_room_that_is_seen_again_is_sure():
    assert judged([0.0] * SUBMAPS) == ([], [])
    assert judged([0.0, 0.03, -0.05, 0.0, 0.05, 0.0]) == ([], [])


@pytest.mark.parametrize("offset", [0.6, -0.6, 1.2])
def test_a_room_that_is_drawn_twice_is_broken(offset):
    doubtful, broken = judged([0.0] * (SUBMAPS - 1) + [offset])
    assert doubtful == broken
    assert broken[-1] == SCANS * SUBMAPS - 1
    assert broken[0] >= SCANS * (SUBMAPS - 2)  # a submap and the one before it


def test_rooms_apart_contradict_nothing():
    assert judged([0.0, 20.0, 40.0]) == ([], [])


def test_a_submap_whose_place_the_graph_does_not_know_is_doubtful():
    assert judged([0.0] * SUBMAPS, 0.9 * UNKNOWN_METRES) == ([], [])
    doubtful, broken = judged([0.0] * SUBMAPS, 1.1 * UNKNOWN_METRES)
    assert (doubtful, broken) == (list(range(2 * SCANS, 3 * SCANS)), [])


@pytest.mark.parametrize("usual", [0.0, 0.02, 0.1, 0.5])
def test_however_much_of_a_map_is_broken_no_right_one_contradicts_itself_so_much(usual):
    share = np.full(12, usual)
    share[4:8] = 1.2 * max(MOST_SHARE, usual)
    broken = are_broken(FEW_SEEN * np.column_stack([share, 1.0 - share]))
    assert broken[5:7].all()
    assert broken[0] == (usual > MOST_SHARE)
    quiet = np.full(12, 0.7 * MOST_SHARE)
    assert not are_broken(FEW_SEEN * np.column_stack([quiet, 1.0 - quiet])).any()


def test_a_person_who_is_passed_where_little_else_is_seen_breaks_no_map():
    counts = np.zeros((12, 2))
    counts[:, 1] = 0.02 * FEW_SEEN
    counts[5, 0] = 0.05 * FEW_SEEN  # nearly as many as all that three submaps see
    assert not are_broken(counts).any()
    assert are_broken(2.0 * counts).any()


def test_a_submap_in_which_a_scan_fits_nothing_is_doubtful():
    fits = np.ones(SCANS * SUBMAPS)
    fits[2 * SCANS] = 1.1 * LOST_FIT
    assert judged([0.0] * SUBMAPS, fits=fits) == ([], [])
    fits[2 * SCANS] = 0.9 * LOST_FIT
    assert judged([0.0] * SUBMAPS, fits=fits) == (list(range(2 * SCANS, 3 * SCANS)), [])


def test_nothing_is_said_before_a_submap_is_complete():
    assert Consistency(GEOMETRY).stamps(np.arange(3.0), np.ones(3)) == ([], [])


def test_doubtful_scans_that_follow_each_other_are_one_span():
    stats = SlamStats(doubtful=[1.0, 2.0, 6.5, 8.0, 20.0], broken=[8.0])
    assert stats.spans() == [
        DoubtSpan(1.0, 6.5, "doubtful"), DoubtSpan(8.0, 8.0, "broken"), DoubtSpan(20.0, 20.0, "doubtful"),
    ]  # fmt: skip
