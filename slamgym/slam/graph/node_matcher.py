"""Matching a scan with a local map made of other nodes' scans; owns the working memory of the kernels."""

import math
from typing import NamedTuple

import numpy as np

from slamgym.core.types import FloatArray, IntArray
from slamgym.slam.graph.config import PoseGraphConfig
from slamgym.slam.graph.correlative_match import paint_levels, search_window
from slamgym.slam.graph.surface_map import align_scan, bind_cells, collect_cells

MARGIN_CELLS = 3
ALIGN_STEPS = 12
ALIGN_REACH = 3.0
"""Residual at which a point's weight has fallen to a quarter [standard deviations]."""
MOST_LEVELS = 6
SEARCH_POINTS = 120
"""The search takes about this many of a scan's points."""
ANGULAR_STEPS = (0.008, 0.06)
"""Bounds of the search's step in heading [rad]."""


class LocalMap(NamedTuple):
    """Surface cells round a pose; see :mod:`slamgym.slam.graph.surface_map`."""

    numbers: np.ndarray  # (rows, cols) int32, number of the occupied cell
    means: FloatArray  # (cells, 4)
    infos: FloatArray  # (cells, 3)
    origin_x: float  # [m]
    origin_y: float  # [m]


class Match(NamedTuple):
    """Where a scan fits into a local map."""

    pose: FloatArray  # (3,) in the local map's frame
    information: FloatArray  # (3, 3)
    fit: float  # share of the points that fit, 0 to 1


class NodeMatcher:
    """Builds local maps and matches scans with them."""

    def __init__(self, config: PoseGraphConfig) -> None:
        self._config = config

    def local_map(
        self, points: FloatArray, counts: IntArray, members: IntArray, poses: FloatArray, centre: FloatArray,
        reach: float,
    ) -> LocalMap:  # fmt: skip
        """Make a local map.

        Args:
            points: (nodes, most points, 2) end points in each node's own frame [m].
            counts: (nodes,) how many of them are set.
            members: (members,) which nodes the map is made of.
            poses: (members, 3) their poses in the frame of the map.
            centre: (3,) what the map is centred on.
            reach: The map extends so far from there [m].
        """
        cell = self._config.cell
        half = math.ceil(reach / cell) + MARGIN_CELLS
        origin_x = (math.floor(centre[0] / cell) - half) * cell
        origin_y = (math.floor(centre[1] / cell) - half) * cell
        index = np.empty((2 * half, 2 * half), dtype=np.int32)
        moments = np.empty((min(int(counts[members].sum()) + 1, index.size), 8))
        places = np.empty((len(moments), 2), dtype=np.int32)
        used = collect_cells(points, counts, poses, members, origin_x, origin_y, cell, index, places, moments)
        means, infos = np.empty((used, 4)), np.empty((used, 3))
        bind_cells(index, places, moments[:used], self._config.surface_sigma, means, infos)
        return LocalMap(index, means, infos, origin_x, origin_y)

    def align(
        self,
        local: LocalMap,
        points: FloatArray,
        start: FloatArray,
        prior: FloatArray,
        prior_info: FloatArray,
    ) -> Match:
        """Refine a pose near its final place; see :func:`slamgym.slam.graph.surface_map.align_scan`."""
        pose, information = np.empty(3), np.empty((3, 3))
        fit = align_scan(
            local.numbers, local.means, local.infos, local.origin_x, local.origin_y, self._config.cell,
            points, start, prior, prior_info, ALIGN_STEPS, ALIGN_REACH, self._config.point_share, pose,
            information,
        )  # fmt: skip
        return Match(pose, information, float(fit))

    def search(
        self,
        local: LocalMap,
        points: FloatArray,
        centre: FloatArray,
        window: float,
        turn: float,
        least: float,
    ) -> tuple[FloatArray, float]:
        """Find the best pose in a window of ``window`` [m] and ``turn`` [rad] round ``centre``.

        Returns:
            The pose (3,) to the precision of a cell, and its score, ``least`` if no pose is better.
        """
        cell = self._config.cell
        cells = max(1, math.ceil(window / cell))
        num_levels = min(MOST_LEVELS, max(1, math.ceil(math.log2(cells + 1))) + 1)
        levels = np.empty((num_levels, *local.numbers.shape), dtype=np.uint8)
        paint_levels(local.numbers, levels)
        points = points[:: max(1, len(points) // SEARCH_POINTS)]
        # One step turns the far points by about a cell: further points would only be blurred by a finer one.
        far = float(np.percentile(np.hypot(points[:, 0], points[:, 1]), 80.0))
        step = min(max(cell / max(far, cell), ANGULAR_STEPS[0]), ANGULAR_STEPS[1])
        count = math.ceil(turn / step)
        angles = step * np.arange(-count, count + 1, dtype=np.float64)
        pose = np.empty(3)
        score = search_window(
            levels, local.origin_x, local.origin_y, cell, points, centre, cells, angles, least, pose
        )
        return pose, float(score)
