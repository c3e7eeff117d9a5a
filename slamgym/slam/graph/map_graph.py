"""What a mapper leaves behind: its graph and its scans, from which a map can be optimised and drawn again."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from slamgym.core.types import (
    BoolArray,
    Float32Array,
    FloatArray,
    IntArray,
    LaserGeometry,
    OccupancyGrid,
)
from slamgym.slam.config import SlamConfig
from slamgym.slam.graph.solver import Edges
from slamgym.slam.hit_count_kernels import BeamTable
from slamgym.slam.hit_counts import HitCountMap

DRAWN_LATTICE = np.array([0.004, 0.004, 0.002])
"""Steps in which poses are drawn into the map [m, m, rad]: what moves less isn't drawn again."""


def drawn_poses(poses: FloatArray) -> FloatArray:
    """Poses (N, 3) as they are drawn: the map follows from the path, however often it was drawn before."""
    return np.round(poses / DRAWN_LATTICE) * DRAWN_LATTICE


class DriveScans(NamedTuple):
    """Scans of one laser on one drive, in the order of time; its nodes follow each other in the graph."""

    first: int
    """The node of the first one."""
    stamps: FloatArray  # (n,) [s]
    ranges: Float32Array  # (n, num_beams) [m], as if each scan had been taken at once
    geometry: LaserGeometry
    config: SlamConfig

    @property
    def nodes(self) -> slice:
        """Their nodes."""
        return slice(self.first, self.first + len(self.stamps))

    def owns(self, nodes: IntArray) -> BoolArray:
        """Which of some nodes (n,) are theirs."""
        return (nodes >= self.nodes.start) & (nodes < self.nodes.stop)

    @property
    def beams(self) -> BeamTable:
        """The laser, for kernels."""
        return BeamTable.of(self.geometry, self.config)


@dataclass(frozen=True)
class MapGraph:
    """A finished graph of one drive or of several."""

    poses: FloatArray
    """(N, 3) of the nodes in the map frame, one a scan [m, m, rad]."""
    edges: Edges
    """What was measured between them; the wheels' errors are taken out."""
    submaps: IntArray
    """(S, 2) first node of each submap, and the node behind its last one."""
    drives: tuple[DriveScans, ...]
    """What was seen from the nodes."""

    def grid(self) -> OccupancyGrid:
        """Draw the map, with the cells of the first drive."""
        return self.counted(*self.drives).occupancy_grid()

    def counted(self, *drives: DriveScans) -> HitCountMap:
        """What some drives count, in the cells of the graph's first."""
        drawn = HitCountMap(drives[0].beams, self.drives[0].config)
        for drive in drives:
            drawn.see_with(drive.beams)
            drawn.draw(drawn_poses(self.poses[drive.nodes]), drive.ranges)
        return drawn

    def moved(self, poses: FloatArray) -> "MapGraph":
        """The same with its nodes at other poses (N, 3)."""
        return replace(self, poses=poses)


def joined_graph(first: MapGraph, second: MapGraph) -> MapGraph:
    """Two graphs in one frame as one, whose nodes follow each other; nothing ties them yet."""
    count = len(first.poses)
    theirs = second.edges
    shifted = theirs._replace(first=theirs.first + count, second=theirs.second + count)
    drives = [drive._replace(first=drive.first + count) for drive in second.drives]
    return MapGraph(
        poses=np.concatenate([first.poses, second.poses]),
        edges=first.edges.joined(shifted),
        submaps=np.concatenate([first.submaps, second.submaps + count]),
        drives=(*first.drives, *drives),
    )
