"""The particles' paths, which share their past: GMapping's trajectory tree."""

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import FloatArray, IntArray


@kernel
def trace_lineage(parents: IntArray, last: int, particle: int, lineage: IntArray) -> int:
    """Follow a particle's ancestors back until they meet the lineage traced before.

    Args:
        parents: (steps, particles) place at the step before of each particle's parent.
        last: Step to begin at.
        particle: Place of the particle at that step.
        lineage: (steps,) place per step, -1 where unset; changed in place up to the common ancestor.

    Returns:
        The first step that was changed; ``last + 1`` if none.
    """
    step = last
    while step >= 0 and lineage[step] != particle:
        lineage[step] = particle
        particle = parents[step, particle]
        step -= 1
    return step + 1


class TrajectoryTree:
    """Pose and parent of each particle at each processed scan, and the scans themselves."""

    def __init__(self, particles: int, num_beams: int) -> None:
        self._length = 0
        self._parents = np.zeros((64, particles), dtype=np.int64)
        self._poses = np.zeros((64, particles, 3))
        self._stamps = np.zeros(64)
        self._ranges = np.zeros((64, num_beams), dtype=np.float32)
        self._pending = np.arange(particles)

    def __len__(self) -> int:
        return self._length

    @property
    def num_bytes(self) -> int:
        """Memory of the tree."""
        return self._parents.nbytes + self._poses.nbytes + self._ranges.nbytes

    @property
    def stamps(self) -> FloatArray:
        """(steps,) [s]."""
        return self._stamps[: self._length]

    @property
    def ranges(self) -> np.ndarray:
        """(steps, num_beams) float32 [m]."""
        return self._ranges[: self._length]

    @property
    def parents(self) -> IntArray:
        """(steps, particles)."""
        return self._parents[: self._length]

    def append(self, stamp: float, poses: FloatArray, ranges: np.ndarray) -> None:
        """Add a processed scan with the pose (particles, 3) of each particle."""
        if self._length == len(self._stamps):
            for name in ("_parents", "_poses", "_stamps", "_ranges"):
                old = getattr(self, name)
                setattr(self, name, np.concatenate([old, np.zeros_like(old)]))
        self._parents[self._length] = self._pending
        self._poses[self._length] = poses
        self._stamps[self._length] = stamp
        self._ranges[self._length] = ranges
        self._pending = np.arange(poses.shape[0])
        self._length += 1

    def resample(self, ancestors: IntArray) -> None:
        """Note which particle each place descends from, after the last processed scan."""
        self._pending = self._pending[ancestors]

    def poses_along(self, lineage: IntArray, first: int = 0) -> FloatArray:
        """Poses, shape (steps - first, 3), along a lineage from step ``first``."""
        steps = np.arange(first, self._length)
        along: FloatArray = self._poses[steps, lineage[steps]]
        return along
