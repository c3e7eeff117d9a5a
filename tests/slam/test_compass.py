"""Walls as a compass: what they say of a heading, and when they say nothing."""

import math
from typing import Any, NamedTuple

import numpy as np
import pytest

from slamgym.slam.graph.compass import FIRST_SUBMAPS, WALL_SPREAD, Compass
from slamgym.slam.graph.pose_graph import PoseGraph
from slamgym.slam.graph.relative import Match
from slamgym.slam.graph.wheels import WheelStep

START = 0.3
"""Heading of the first node [rad]."""


class Walls(NamedTuple):
    """A submap whose node is headed somewhere, with surfaces at some angles of the map [rad]."""

    heading: float
    angles: tuple[float, ...] = (0.1, 0.1 + math.pi / 2, 0.1 + math.pi)
    first = 1

    def lines(self) -> tuple[None, np.ndarray]:
        seen = np.array(self.angles) - self.heading
        return None, np.column_stack([np.cos(seen), np.sin(seen), np.ones(len(seen))])


class Path:
    """A graph as far as a compass asks it."""

    def __init__(self, deviation: float) -> None:
        self.poses = np.array([(0.0, 0.0, START), (0.0, 0.0, 0.0)])
        self.covariance = np.diag([0.0, 0.0, deviation**2])
        self.ties: list[Match] = []

    def tie(self, match: Match) -> None:
        self.ties.append(match)


def ties(walls: Walls, believed: float, deviation: float = 0.05) -> list[Match]:
    """What is added for a submap that is believed to be headed somewhere, after the first ones."""
    compass: Any = Compass()
    for heading in np.linspace(-3.0, 3.0, FIRST_SUBMAPS):
        path = Path(0.01)
        path.poses[1, 2] = heading
        compass.read(Walls(heading), path)
        assert not path.ties
    path = Path(deviation)
    path.poses[1, 2] = believed
    compass.read(walls, path)
    return path.ties


@pytest.mark.parametrize("heading", [-2.0, 0.0, 0.8, 3.1])
def test_the_walls_tell_the_heading_wherever_the_robot_is_headed(heading):
    for off in (-0.15, 0.0, 0.15):
        (tie,) = ties(Walls(heading), heading + off)
        assert (tie.old, tie.new) == (0, 1)
        assert tie.measured == pytest.approx([0.0, 0.0, heading - START])
        assert np.linalg.matrix_rank(tie.information) == 1


def test_walls_say_nothing_of_a_heading_that_is_known_better():
    assert ties(Walls(0.0), 0.05, deviation=0.9 * WALL_SPREAD) == []


def test_neither_another_wing_nor_a_round_room_says_anything():
    assert ties(Walls(0.0, (0.5, 0.5 + math.pi / 2)), 0.0) == []
    assert ties(Walls(0.0, tuple(np.linspace(0.0, 2.0 * math.pi, 37))), 0.0) == []
    assert ties(Walls(0.0, ()), 0.0) == []


def test_a_heading_is_no_short_cut_to_a_place():
    graph, nothing = PoseGraph(), np.zeros(2)
    for node in range(101):
        moved = np.array([0.25 * (node > 0), 0.0, 0.0])
        step = WheelStep(moved, np.zeros((3, 4)), nothing + 1e-6)
        graph.append(np.array([0.25 * node, 0.0, 0.0]), step, 1e6 * np.eye(3), np.zeros((3, 3)))
    graph.tie(Match(0, 100, np.zeros(3), np.diag([0.0, 0.0, WALL_SPREAD**-2])))
    graph.optimise([0, 100], 2)
    assert not graph.is_tied(0)
    assert graph.relative_covariance(0)[0, 0] > 0.1**2
