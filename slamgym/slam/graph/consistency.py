"""Consistency of a map with itself: surfaces that later scans see through, and places that the graph doesn't know.

A beam that ends well behind a surface of an earlier submap, which faces the laser, contradicts that submap: a room that
was drawn twice hides nothing of its other copy (visibility consistency; Huber and Hebert, IVC 2003). Doors and people
contradict, too, so a submap is *broken* where it contradicts much more than is usual in the same map. It is *doubtful*
where the graph itself doesn't know how it lies to where the robot was some metres before.
"""

import math
from collections.abc import Iterator

import numpy as np

from slamgym.core.geometry import compose
from slamgym.core.jit import kernel
from slamgym.core.types import Float32Array, FloatArray, LaserGeometry, Pose2D
from slamgym.metrics.trajectory import relative_poses
from slamgym.slam.graph.pose_graph import PoseGraph
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

    def judge(
        self, number: int, submaps: list[Submap], graph: PoseGraph, ranges: Float32Array
    ) -> None:
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
        lasers = np.array(
            [compose(Pose2D(*graph.poses[node].tolist()), self._mount) for node in nodes]
        )
        older, scans = (
            [submap for submap in submaps[:number] if not submap.is_older_map],
            ranges[nodes],
        )
        for submap, places in near_submaps(older, graph, lasers):
            look_through(*submap.lines(), places, scans, *self._beams, counts)
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


def near_submaps(
    submaps: list[Submap], graph: PoseGraph, lasers: FloatArray
) -> Iterator[tuple[Submap, FloatArray]]:
    """Those of some submaps that one of the lasers (K, 3) may see, and the lasers (K, 3) in their frames."""
    count = len(submaps)
    frames = graph.poses[[submap.first for submap in submaps]].repeat(len(lasers), axis=0)
    places = relative_poses(frames, np.tile(lasers, (count, 1))).reshape(count, len(lasers), 3)
    low = np.array([submap.corner for submap in submaps]).reshape(-1, 1, 2)
    sizes = np.array([submap.grid.shape[1::-1] for submap in submaps]).reshape(-1, 1, 2)
    beyond = np.maximum(low - places[..., :2], places[..., :2] - low - SUBMAP_CELL * sizes)
    for index in np.flatnonzero((beyond < SIGHT).all(axis=2).any(axis=1)).tolist():
        yield submaps[index], places[index]


@kernel
def look_through(
    means: FloatArray,
    sides: FloatArray,
    lasers: FloatArray,
    ranges: Float32Array,
    angle_min: float,
    step: float,
    longest: float,
    counts: FloatArray,
) -> None:
    """Count the surfaces that scans pass, and those that they end at.

    Args:
        means: (n, 2) of the surfaces [m].
        sides: (n, 3) unit vectors to the side that they face.
        lasers: (K, 3) poses, in the same frame.
        ranges: (K, num_beams) [m].
        angle_min: Direction of the first beam [rad].
        step: Angle from each beam to the next [rad].
        longest: A beam that is no shorter met nothing [m].
        counts: (2,) what is counted is added to it.
    """
    for number in range(len(lasers)):
        laser, scan = lasers[number], ranges[number]
        for i in range(len(means)):
            dx, dy = means[i, 0] - laser[0], means[i, 1] - laser[1]
            distance = math.hypot(dx, dy)
            if distance < SUBMAP_CELL or distance > SIGHT:
                continue
            cosine = -(dx * sides[i, 0] + dy * sides[i, 1]) / distance
            turn = (
                (math.atan2(dy, dx) - laser[2] - angle_min)
                * math.copysign(1.0, step)
                / (2.0 * math.pi)
            )
            beam = round((turn - math.floor(turn)) * 2.0 * math.pi / abs(step))
            if cosine < LEAST_COSINE or beam < 1 or beam > len(scan) - 2:
                continue
            near, far = min(scan[beam - 1 : beam + 2]), max(scan[beam - 1 : beam + 2])
            if not (near > 0.0 and far < longest):
                continue
            if near > distance + BEHIND / cosine:
                counts[0] += 1.0
            elif far > distance - SUBMAP_CELL / cosine:
                counts[1] += 1.0
