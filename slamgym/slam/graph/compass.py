"""Walls as a compass: most of a building's run in two directions (Coughlan and Yuille 1999, *Manhattan World*).

Matches bound the heading from submap to submap only, so its error grows with the way. The directions of walls in a
submap are off by 12 mrad, however far apart two are.
"""

import cmath

import numpy as np

from slamgym.core.types import FloatArray
from slamgym.slam.graph.pose_graph import PoseGraph
from slamgym.slam.graph.relative import Match
from slamgym.slam.graph.submaps import Submap

WALL_SPREAD = 0.02
"""Standard deviation of a submap's walls [rad]; where the heading is known better, the walls aren't asked. Without them
the heading in a school 140 m long was off by 120 mrad after 1,900 s, and the place by 4.2 m; with them by 1 mrad and
0.2 m."""
FIRST_SUBMAPS = 24
"""From so many the directions are learned, those of an uncertain heading less: 50 m of driving."""
CLEAR = 0.5
"""Least mean of the unit vectors of four times the walls' angles: 1 if all are parallel or at right angles."""
OBLIQUE = 0.2
"""Walls further from the directions are those of another wing [rad]."""


class Compass:
    """Learns the two directions, and tells the graph how submaps that show them are headed."""

    def __init__(self) -> None:
        self._walls = 0j  # the sum of vectors of four times the walls' angles in the map
        self._count = 0  # of submaps in it

    def read(self, submap: Submap, graph: PoseGraph) -> None:
        """Tie a finished submap's heading to the first node's, if its walls tell it better than the path."""
        _, normals = submap.lines()
        seen = _sum_of_directions(normals)
        if abs(seen) <= CLEAR * len(normals):
            return
        believed = graph.poses[submap.first, 2]
        variance = graph.covariance[2, 2]
        seen *= cmath.exp(4j * believed) / abs(seen)
        if self._count < FIRST_SUBMAPS:
            self._walls += seen / (WALL_SPREAD**2 + variance)
            self._count += 1
            return
        off = cmath.phase(self._walls / seen) / 4.0
        if variance > WALL_SPREAD**2 and abs(off) < OBLIQUE:
            turn = believed + off - graph.poses[0, 2]
            measured = np.array([0.0, 0.0, turn])
            information = np.diag([0.0, 0.0, WALL_SPREAD**-2])
            graph.tie(Match(0, submap.first, measured, information))


def _sum_of_directions(normals: FloatArray) -> complex:
    """Sum of unit vectors of four times the angles of walls, whose normals (n, 3) are given."""
    x = normals[:, 0]
    y = normals[:, 1]
    cos_twice = x * x - y * y
    sin_twice = 2.0 * x * y
    cos = cos_twice * cos_twice - sin_twice * sin_twice
    sin = 2.0 * cos_twice * sin_twice
    return complex(cos.sum(), sin.sum())
