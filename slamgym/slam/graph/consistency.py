"""Consistency of a map with itself: surfaces that later scans see through, and places that the graph doesn't know.

A beam that ends well behind a surface of an earlier submap, which faces the laser, contradicts that submap: a room that
was drawn twice hides nothing of its other copy (visibility consistency; Huber and Hebert, IVC 2003). Doors and people
contradict, too, so a submap is *broken* where it contradicts much more than is usual in the same map, or more than any
right map does. It is *doubtful* where the graph itself doesn't know how it lies to where the robot was some metres
before, or where a scan fits nothing that was seen.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import BoolArray, Float32Array, FloatArray, LaserGeometry
from slamgym.metrics.trajectory import relative_poses
from slamgym.slam.end_points import beam_at
from slamgym.slam.graph.pose_graph import PoseGraph
from slamgym.slam.graph.relative import moved_by
from slamgym.slam.graph.submaps import SUBMAP_CELL, Submap

SIGHT = 8.0
"""Surfaces this near to the laser are looked at [m]."""
LEAST_COSINE = 0.5
"""Surfaces that face the laser by more than this are looked at (cosine of the angle to the normal)."""
BEHIND = 0.3
"""A beam passes a surface that it ends so far behind [m]; it ends at one that it comes to within a cell."""
JUDGED_SCANS = 3
"""Scans of a submap that are held against earlier submaps."""
FEW_SEEN = 1000
"""What scans of three submaps in a row pass is a share of at least so many surfaces: fewer are those of a person. With
450, 5 of 12 right drives of a TurtleBot3 in offices, corridors and labs were called broken."""
BROKEN_SHARE = 0.06
"""A submap is broken if its share and its neighbours' is more than this and ``USUAL_SHARES`` medians."""
USUAL_SHARES = 6.0
"""A broken submap's share exceeds ``BROKEN_SHARE`` by so many times the median of the shares of all submaps."""
MOST_SHARE = 0.2
"""A submap with a larger share is broken, however many others are, too. Right maps of five public logs reach 0.17,
wrong ones of three with a shorter laser 0.28 to 0.81. With this limit alone 2 of 8 wrong drives of the zoo were
believed, which have 0.13 and 0.16; with people in a hall right ones reach 0.14."""
LOST_FIT = 0.1
"""A submap is doubtful if so small a share of one of its scans fitted what was seen before, as when the robot is
carried away: 4 of 8 such scans in simulated homes fit by less, none of seven right public logs (0.11 and more)."""
STRETCH_METRES = 10.0
"""A submap is compared with where the robot was so much driving before [m]."""
UNKNOWN_METRES = 0.5
"""A submap is doubtful if its standard deviation from where the robot was before is more than this [m]."""


class Judgement(NamedTuple):
    """What was found of a submap."""

    submap: Submap
    counts: FloatArray  # (2,) surfaces that its scans pass, and end at
    deviation: float  # from where the robot was ``STRETCH_METRES`` before [m]


class Consistency:
    """What each submap says of the map.

    Args:
        geometry: The scanner.
    """

    def __init__(self, geometry: LaserGeometry) -> None:
        self._geometry = geometry
        self._judged: dict[int, Judgement] = {}  # by the submap's number

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
        own = submaps[number]
        counts = np.zeros(2)
        last = own.first + len(own.poses) - 1
        spread = np.linspace(own.first, last, JUDGED_SCANS + 2)[1:-1]
        nodes = np.unique(spread.astype(np.int64)).tolist()
        mount = np.array(self._geometry.mount)
        lasers = np.array([moved_by(graph.poses[node], mount) for node in nodes])
        scans = ranges[nodes]
        for submap, places in near_submaps(submaps[:number], graph, lasers):
            counts += look_through(
                *submap.lines(),
                places,
                scans,
                self._geometry.angle_min,
                self._geometry.angle_increment,
                self._geometry.range_max,
            )
        firsts = np.array([submap.first for submap in submaps[: number + 1]])
        since = graph.driven[own.first] - graph.driven[firsts]
        is_before = since >= min(STRETCH_METRES, since[0])
        old = int(firsts[is_before][-1])
        deviation = graph.deviation(old, own.first)
        self._judged[number] = Judgement(own, counts, deviation)

    def stamps(self, stamps: FloatArray, fits: FloatArray) -> tuple[list[float], list[float]]:
        """Times of the scans that are in doubt, broken ones among them, and of these alone [s].

        Args:
            stamps: (N,) of all scans [s].
            fits: (N,) shares of their points that fitted what was seen before; 1 where that isn't known.
        """
        if not self._judged:
            return [], []
        judgements = list(self._judged.values())
        counts = np.array([judgement.counts for judgement in judgements])
        in_doubt = np.zeros(len(stamps), dtype=bool)
        broken = np.zeros(len(stamps), dtype=bool)
        for judgement, is_broken in zip(judgements, are_broken(counts), strict=True):
            first = judgement.submap.first
            nodes = slice(first, first + len(judgement.submap.poses))
            is_unknown = judgement.deviation > UNKNOWN_METRES
            is_lost = bool((fits[nodes] < LOST_FIT).any())
            broken[nodes] = is_broken
            in_doubt[nodes] = is_broken or is_unknown or is_lost
        return stamps[in_doubt].tolist(), stamps[broken].tolist()


def are_broken(counts: FloatArray) -> BoolArray:
    """True for submaps (N,) where scans pass much more surfaces than is usual, or than in any right map.

    Args:
        counts: (N, 2) of submaps in a row, surfaces that their scans pass, and end at.
    """
    padded = np.pad(counts, ((1, 1), (0, 0)))
    stretches = padded[:-2] + padded[1:-1] + padded[2:]
    shares = stretches[:, 0] / np.maximum(stretches.sum(axis=1), FEW_SEEN)
    limit = min(BROKEN_SHARE + USUAL_SHARES * np.median(shares), MOST_SHARE)
    return shares > limit


def near_submaps(
    submaps: list[Submap], graph: PoseGraph, lasers: FloatArray
) -> Iterator[tuple[Submap, FloatArray]]:
    """Those of some submaps that one of the lasers (K, 3) may see, and the lasers (K, 3) in their frames."""
    count = len(submaps)
    firsts = [submap.first for submap in submaps]
    frames = graph.poses[firsts].repeat(len(lasers), axis=0)
    places = relative_poses(frames, np.tile(lasers, (count, 1)))
    places = places.reshape(count, len(lasers), 3)
    points = places[..., :2]
    low = np.array([submap.corner for submap in submaps]).reshape(-1, 1, 2)
    sizes = np.array([submap.grid.shape[1::-1] for submap in submaps]).reshape(-1, 1, 2)
    beyond = np.maximum(low - points, points - low - SUBMAP_CELL * sizes)
    is_near = (beyond < SIGHT).all(axis=2)
    for index in np.flatnonzero(is_near.any(axis=1)).tolist():
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
) -> tuple[int, int]:
    """Count the surfaces that scans pass, and those that they end at.

    Args:
        means: (n, 2) of the surfaces [m].
        sides: (n, 3) unit vectors to the side that they face.
        lasers: (K, 3) poses, in the same frame.
        ranges: (K, num_beams) [m].
        angle_min: Direction of the first beam [rad].
        step: Angle from each beam to the next [rad].
        longest: A beam that is no shorter met nothing [m].
    """
    passed = met = 0
    for number in range(len(lasers)):
        laser = lasers[number]
        scan = ranges[number]
        for i in range(len(means)):
            dx = means[i, 0] - laser[0]
            dy = means[i, 1] - laser[1]
            distance = math.hypot(dx, dy)
            if distance < SUBMAP_CELL or distance > SIGHT:
                continue
            cosine = -(dx * sides[i, 0] + dy * sides[i, 1]) / distance
            beam = beam_at(math.atan2(dy, dx) - laser[2] - angle_min, step)
            if cosine < LEAST_COSINE or beam < 1 or beam > len(scan) - 2:
                continue
            around = scan[beam - 1 : beam + 2]
            near = min(around)
            far = max(around)
            if not (near > 0.0 and far < longest):
                continue
            if near > distance + BEHIND / cosine:
                passed += 1
            elif far > distance - SUBMAP_CELL / cosine:
                met += 1
    return passed, met
