"""A place that looks like another is not tied to it."""

import numpy as np
import pytest

from slamgym.core.types import LaserGeometry, Pose2D
from slamgym.sim.raycast import cast_rays
from slamgym.slam import SlamConfig
from slamgym.slam.graph.mapper import PoseGraphMapper

GEOMETRY = LaserGeometry(181, -np.pi / 2, np.pi / 180, 0.1, 8.0, Pose2D(0.0, 0.0, 0.0))


def scan_points(x: float, pillars: list[float]) -> np.ndarray:
    """End points of a scan in a corridor with a pair of pillars at each of these distances."""
    sides = [(p, side, p + 0.2, side * 0.6) for p in pillars for side in (-1, 1)]
    segments = np.array([(-30, -1, 30, -1), (-30, 1, 30, 1), *sides], dtype=np.float64)
    ranges = np.empty(GEOMETRY.num_beams)
    cast_rays(x, 0.0, 0.0, GEOMETRY.angle_min, GEOMETRY.angle_increment, segments, 3.0, ranges)
    angles = GEOMETRY.angle_min + GEOMETRY.angle_increment * np.arange(GEOMETRY.num_beams)
    seen = np.isfinite(ranges)
    return ranges[seen, None] * np.column_stack([np.cos(angles), np.sin(angles)])[seen]


@pytest.mark.parametrize(("pillars", "is_found"), [([1.5], True), ([1.5, 4.0], False)])
def test_of_two_places_that_fit_alike_none_is_taken(pillars: list[float], is_found: bool):
    mapper = PoseGraphMapper(
        SlamConfig(mode="pose_graph"), GEOMETRY, Pose2D(0.0, 0.0, 0.0), np.random.default_rng(0)
    )
    for x in np.arange(-1.0, 4.01, 0.5):
        seen = scan_points(x, pillars)
        mapper._nodes.append(poses=(x, 0.0, 0.0), counts=len(seen))
        mapper._nodes["points"][-1, : len(seen)] = seen
    members, flat = np.arange(11), np.zeros((3, 3))
    # The place is 0.9 m behind the guess; with two pairs of pillars there is another 1.6 m before it.
    guess = np.array([1.9, 0.0, 0.0])  # seen from node 0 at -1
    points = scan_points(0.0, pillars[:1])
    match = mapper._match(points, 0, members, guess, flat, 2.0, 0.1, 0.5)
    if is_found:
        assert match is not None
        assert match.pose == pytest.approx([1.0, 0.0, 0.0], abs=0.02)
    else:
        assert match is None
