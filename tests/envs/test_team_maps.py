"""Where the maps of a team lie on each other, by their graphs."""

import functools
import math

import numpy as np
import pytest
from drawn_drives import FLAT, HERE, THERE, drive

from slamgym.core.geometry import between, compose, inverse
from slamgym.core.types import Pose2D
from slamgym.envs.team.maps import ALIGN_INTERVAL, TeamMaps, placed
from slamgym.metrics.trajectory import align_se2
from slamgym.slam import SlamConfig
from slamgym.slam.replay import replay

MIRRORED = FLAT * [-1.0, 1.0, -1.0, 1.0]


@functools.cache
def mapped(name):
    """A drive that has been mapped, and the true pose of its frame in the building's."""
    walls, way = {
        "here": (FLAT, HERE),
        "there": (FLAT, THERE),
        "mirrored": (MIRRORED, (np.array(THERE) * [-1.0, 1.0]).tolist()),
    }[name]
    log, truth = drive(walls, way, seed=len(name))
    config = SlamConfig.for_log(log.geometry.range_max, log.geometry.num_beams)
    result = replay(log, config, np.random.default_rng(0))
    stamps = np.searchsorted(result.trajectory.stamps, result.processed.stamps)
    return result, align_se2(result.graph.poses[:, :2], truth[stamps, :2])


def true_place():
    """Of the second drive's frame in the first's."""
    return between(mapped("here")[1], mapped("there")[1])


def off(place):
    """How far a place is from the true one [m], [rad]."""
    apart = between(true_place(), place)
    return math.hypot(apart.x, apart.y), abs(apart.theta)


@pytest.mark.parametrize("error", [None, Pose2D(0.25, -0.2, 0.04)])
def test_a_map_is_laid_where_it_belongs_with_a_rough_guess_or_without_one(error):
    guess = None if error is None else compose(true_place(), error)
    place = placed(mapped("here")[0].graph, mapped("there")[0].graph, guess)
    metres, radians = off(place)
    # Each map bends by some centimetres over eight metres, which no transform undoes.
    assert metres < 0.1
    assert radians < math.radians(1.0)


def test_a_map_that_does_not_belong_there_is_not_used():
    assert placed(mapped("here")[0].graph, mapped("mirrored")[0].graph, None) is None


class _Mapped:
    """A mapper that has mapped a drive."""

    def __init__(self, name):
        self._result, _ = mapped(name)

    def graph(self):
        return self._result.graph

    def occupancy_grid(self):
        return self._result.grid


def test_robots_of_unknown_starts_find_each_other_once_they_have_mapped_enough():
    maps = TeamMaps([_Mapped("here"), _Mapped("there")], None)
    everyone = np.ones((2, 2), dtype=bool)
    poses = [Pose2D(0.0, 0.0, 0.0)] * 2
    maps.exchange(everyone, poses, 2.0)
    assert maps.mates(0) == {}, "nobody searches from the first second on"
    maps.exchange(everyone, poses, ALIGN_INTERVAL + 2.0)
    assert off(maps.place(0, 1))[0] < 0.1
    assert maps.place(1, 0) == pytest.approx(inverse(maps.place(0, 1)))
    assert maps.mates(0)[1] == pytest.approx(maps.place(0, 1))
    told = maps.shared[0].told
    own = _Mapped("here").occupancy_grid().frame
    assert (told.frame.origin_x - own.origin_x) / 0.05 == pytest.approx(
        round((told.frame.origin_x - own.origin_x) / 0.05), abs=1e-6
    ), "it lies on the lattice of the own map"
