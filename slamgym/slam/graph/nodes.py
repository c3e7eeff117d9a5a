"""The nodes of a pose graph: scans, their end points and their poses."""

import numpy as np

from slamgym.core.types import FloatArray, IntArray, LaserScan


class GraphNodes:
    """The scans and their poses, in arrays that double when they are full."""

    def __init__(self, num_beams: int) -> None:
        self._length = 0
        self._poses = np.zeros((64, 3))
        self._stamps = np.zeros(64)
        self._points = np.zeros((64, num_beams, 2))
        self._counts = np.zeros(64, dtype=np.int64)
        self._ranges = np.zeros((64, num_beams), dtype=np.float32)

    def __len__(self) -> int:
        return self._length

    @property
    def num_bytes(self) -> int:
        """Memory of scans and points."""
        return self._points.nbytes + self._ranges.nbytes

    @property
    def poses(self) -> FloatArray:
        """(N, 3) current estimates; may be written to."""
        return self._poses[: self._length]

    @property
    def stamps(self) -> FloatArray:
        """(N,) [s]."""
        return self._stamps[: self._length]

    @property
    def ranges(self) -> np.ndarray:
        """(N, num_beams) float32 [m]."""
        return self._ranges[: self._length]

    @property
    def points(self) -> FloatArray:
        """(N, num_beams, 2) end points in each robot frame [m]."""
        return self._points[: self._length]

    @property
    def counts(self) -> IntArray:
        """(N,) how many of them are set."""
        return self._counts[: self._length]

    def end_points(self, node: int) -> FloatArray:
        """(n, 2) end points of one node in its robot frame [m]."""
        return self._points[node, : self._counts[node]]

    def append(self, scan: LaserScan, pose: FloatArray, points: FloatArray) -> None:
        """Add a scan with its pose (3,) and end points (n, 2) in the robot frame."""
        if self._length == len(self._stamps):
            for name in ("_poses", "_stamps", "_points", "_counts", "_ranges"):
                old = getattr(self, name)
                setattr(self, name, np.concatenate([old, np.zeros_like(old)]))
        self._poses[self._length] = pose
        self._stamps[self._length] = scan.stamp
        self._points[self._length, : len(points)] = points
        self._counts[self._length] = len(points)
        self._ranges[self._length] = scan.ranges
        self._length += 1
