"""Consistency of a map with itself: surfaces that later scans see through, and places that the graph doesn't know.

A beam that ends well behind a surface of an earlier submap, which faces the laser, contradicts that submap: a room that
was drawn twice hides nothing of its other copy (visibility consistency; Huber and Hebert, IVC 2003). Doors and people
contradict, too, so a submap is *broken* where it contradicts much more than is usual in the same map. It is *doubtful*
where the graph itself doesn't know how it lies to where the robot was some metres before.
"""

import math

import numpy as np

from slamgym.core.geometry import compose
from slamgym.core.jit import kernel
from slamgym.core.types import Float32Array, FloatArray, LaserGeometry, Pose2D
from slamgym.slam.graph.pose_graph import PoseGraph
from slamgym.slam.graph.relative import seen_from
from slamgym.slam.graph.submaps import SUBMAP_CELL, Submap

SIGHT, LEAST_COSINE = 8.0, 0.5
"""Surfaces this near to the laser [m] that face it by more than the second are looked at."""
BEHIND = 0.3
"""A beam passes a surface that it ends so far behind [m]; it ends at one that it comes to within a cell."""
SCANS, FEW_SEEN = 3, 450
"""Scans of a submap that are held against earlier ones; and least number of surfaces of which what three submaps, one
after the other, pass is a share."""
BROKEN_SHARE, USUAL_SHARES = 0.06, 6.0
"""A submap is broken if its share and its neighbours' is more than this and so many times the median of all: right maps
of five public logs reach 0.93 of it, and wrong ones of two 1.7."""
STRETCH_METRES, UNKNOWN_METRES = 10.0, 0.5
"""A submap is doubtful if its deviation from where the robot was so much driving before is more than the second [m]."""


class Consistency:
    """What each submap says of the map.

    Args:
        geometry: The scanner.
    """

    def __init__(self, geometry: LaserGeometry) -> None:
        self._mount = geometry.mount
        self._beams = geometry.angle_min, geometry.angle_increment, geometry.range_max
        # Surfaces passed and ended at, and the deviation [m].
        self._submaps: dict[int, tuple[Submap, FloatArray, float]] = {}

    def judge(self, number: int, submaps: list[Submap], graph: PoseGraph, ranges: Float32Array) -> None:
        """Hold a submap against the earlier ones.

        Args:
            number: Of the submap.
            submaps: All of them.
            graph: The graph.
            ranges: (N, num_beams) of all scans [m].
        """
        own, counts = submaps[number], np.zeros(2)
        if own.is_older_map:
            return
        last = own.first + len(own.poses) - 1
        nodes = np.unique(np.linspace(own.first, last, SCANS + 2)[1:-1].astype(np.int64)).tolist()
        lasers = [np.array(compose(Pose2D(*graph.poses[node].tolist()), self._mount)) for node in nodes]
        for submap in submaps[:number]:
            if submap.is_older_map:
                continue
            places = [seen_from(graph.poses[submap.first], laser) for laser in lasers]
            if not any(submap.is_near(place, SIGHT) for place in places):
                continue
            means, sides = submap.lines()
            for node, place in zip(nodes, places, strict=True):
                look_through(means, sides, place, ranges[node], *self._beams, counts)
        firsts = np.array([submap.first for submap in submaps[: number + 1]])
        since = graph.driven[own.first] - graph.driven[firsts]
        old = int(firsts[since >= min(STRETCH_METRES, since[0])][-1])
        self._submaps[number] = own, counts, graph.deviation(old, own.first)

    def stamps(self, stamps: FloatArray) -> tuple[list[float], list[float]]:
        """Times of the scans that are in doubt, broken ones among them, and of these alone [s].

        Args:
            stamps: (N,) of all scans [s].
        """
        kinds = np.zeros(len(stamps), dtype=np.int64)
        if not self._submaps:
            return [], []
        submaps, counts, deviations = zip(*self._submaps.values(), strict=True)
        padded = np.pad(np.array(counts), ((1, 1), (0, 0)))
        stretches = padded[:-2] + padded[1:-1] + padded[2:]
        shares = stretches[:, 0] / np.maximum(stretches.sum(axis=1), FEW_SEEN)
        broken = shares > BROKEN_SHARE + USUAL_SHARES * float(np.median(shares))
        for submap, is_broken, deviation in zip(submaps, broken, deviations, strict=True):
            kind = 2 * is_broken or deviation > UNKNOWN_METRES
            kinds[submap.first : submap.first + len(submap.poses)] = kind
        return stamps[kinds > 0].tolist(), stamps[kinds > 1].tolist()


@kernel
def look_through(
    means: FloatArray,
    sides: FloatArray,
    laser: FloatArray,
    ranges: Float32Array,
    angle_min: float,
    step: float,
    longest: float,
    counts: FloatArray,
) -> None:
    """Count the surfaces that a scan passes, and those that it ends at.

    Args:
        means: (n, 2) of the surfaces [m].
        sides: (n, 3) unit vectors to the side that they face.
        laser: (3,) pose, in the same frame.
        ranges: (num_beams,) [m].
        angle_min: Direction of the first beam [rad].
        step: Angle from each beam to the next [rad].
        longest: A beam that is no shorter met nothing [m].
        counts: (2,) what is counted is added to it.
    """
    for i in range(len(means)):
        dx, dy = means[i, 0] - laser[0], means[i, 1] - laser[1]
        distance = math.hypot(dx, dy)
        if distance < SUBMAP_CELL or distance > SIGHT:
            continue
        cosine = -(dx * sides[i, 0] + dy * sides[i, 1]) / distance
        turn = (math.atan2(dy, dx) - laser[2] - angle_min) * math.copysign(1.0, step) / (2.0 * math.pi)
        beam = round((turn - math.floor(turn)) * 2.0 * math.pi / abs(step))
        if cosine < LEAST_COSINE or beam < 1 or beam > len(ranges) - 2:
            continue
        near, far = min(ranges[beam - 1 : beam + 2]), max(ranges[beam - 1 : beam + 2])
        if not (near > 0.0 and far < longest):
            continue
        if near > distance + BEHIND / cosine:
            counts[0] += 1.0
        elif far > distance - SUBMAP_CELL / cosine:
            counts[1] += 1.0
