"""The particles' maps, made of shared tiles; paths that share their past (GMapping's trajectory tree); and weights."""

import numpy as np

from slamgym.core.errors import SlamgymError
from slamgym.core.jit import kernel, plain
from slamgym.core.portable import exp
from slamgym.core.types import FloatArray, IntArray
from slamgym.slam.columns import Columns
from slamgym.slam.tiles import TILE, TileMaps, TilePool, copy_maps, register_scan


@kernel
def trace_lineage(parents: IntArray, particle: int) -> IntArray:
    """Place per step (steps,) of the ancestors of the particle at a place of the last one.

    Args:
        parents: (steps, particles) place at the step before of each particle's parent.
        particle: Its place.
    """
    lineage = np.empty(len(parents), dtype=np.int64)
    for step in range(len(parents) - 1, -1, -1):
        lineage[step] = particle
        particle = parents[step, particle]
    return lineage


class TrajectoryTree(Columns):
    """Pose and parent of each particle at each processed scan, and the scans themselves.

    Columns: ``parents`` (particles,), ``poses`` (particles, 3), ``stamps`` [s] and ``ranges`` (num_beams,) [m].
    """

    def __init__(self, particles: int, num_beams: int) -> None:
        super().__init__(
            {"parents": np.int64, "ranges": np.float32},
            parents=(particles,),
            poses=(particles, 3),
            stamps=(),
            ranges=(num_beams,),
        )
        self._every = np.arange(particles)
        self._pending = self._every  # parents of the particles of the next scan

    def add(self, stamp: float, poses: FloatArray, ranges: np.ndarray) -> None:
        """Add a processed scan with the pose (particles, 3) of each particle."""
        self.append(parents=self._pending, poses=poses, stamps=stamp, ranges=ranges)
        self._pending = self._every

    def resample(self, ancestors: IntArray) -> None:
        """Note which particle each place descends from, after the last processed scan."""
        self._pending = self._pending[ancestors]

    def path(self, particle: int) -> FloatArray:
        """Poses (steps, 3) of the ancestors of the particle at a place of the last step."""
        return self["poses"][np.arange(len(self)), trace_lineage(self["parents"], particle)]


LIKELIHOOD_GAIN = 3.0
"""GMapping's ``ogain``: flattens the weights."""


def normalized_weights(log_weights: FloatArray) -> FloatArray:
    """Weights that sum to 1, flattened as GMapping does: exp(l / (gain x particles)).

    Args:
        log_weights: (particles,) log-likelihood since the last resampling.
    """
    weights = exp((log_weights - log_weights.max()) / (LIKELIHOOD_GAIN * len(log_weights)))
    return weights / weights.sum()


def effective_sample_size(weights: FloatArray) -> float:
    """N_eff = 1 / sum of squares, from 1 (one particle has all the weight) to the number of particles."""
    return float(1.0 / np.square(weights).sum())


def systematic_resample(weights: FloatArray, uniform: float) -> IntArray:
    """Draw as many ancestors as there are particles, particle i about so often as its weight says.

    Args:
        weights: (particles,) that sum to 1.
        uniform: One draw from [0, 1).

    Returns:
        (particles,) ancestor of each place. Every survivor keeps its own place, so that only the maps of those that
        die are replaced.
    """
    count = len(weights)
    ticks = (np.arange(count) + uniform) / count
    drawn = np.searchsorted(np.cumsum(weights), ticks, side="right").clip(max=count - 1)
    copies = np.bincount(drawn, minlength=count)
    ancestors = np.arange(count)
    dead = copies == 0
    copies[~dead] -= 1
    ancestors[dead] = np.repeat(np.arange(count), copies)
    return ancestors


FIRST_TILES = 1024
"""Tiles of a new pool."""
GROWTH_TILES = 8
"""Tables grow by at least so many tiles on a side, so that they seldom grow."""


class ParticleMaps:
    """One end-point map per particle, shared copy-on-write (see :mod:`slamgym.slam.tiles`).

    Attributes:
        resolution: Cell size [m].
        pool: The tiles.
        tables: (particles, rows, cols) int32 tile numbers.
        origin: (2,) lower left corner of the tables [m].
    """

    def __init__(self, particles: int, resolution: float, memory_limit_mb: float) -> None:
        self.resolution = resolution
        self.pool = TilePool.empty(FIRST_TILES)
        self.tables = np.zeros((particles, 0, 0), dtype=np.int32)
        # Tile (col, row) of the lattice where the tables begin.
        self._first = np.zeros(2, dtype=np.int64)
        self.origin: FloatArray = np.zeros(2)
        self._memory_limit = memory_limit_mb * 1e6

    @property
    def tile_maps(self) -> TileMaps:
        """The maps as the kernels take them, until the next change of the pool or the tables."""
        return TileMaps(self.pool, self.tables, self.origin, self.resolution)

    @property
    def num_bytes(self) -> int:
        """Memory of the maps."""
        return sum(array.nbytes for array in self.pool) + self.tables.nbytes

    def cover(self, poses: FloatArray, radius: float) -> None:
        """Let the tables cover all points within ``radius`` [m] of the poses (particles, 3)."""
        side = TILE * self.resolution
        # Tiles (col, row) of the lattice.
        first = np.floor((poses[:, :2].min(axis=0) - radius) / side).astype(np.int64)
        end = np.floor((poses[:, :2].max(axis=0) + radius) / side).astype(np.int64) + 1
        particles, rows, cols = self.tables.shape
        before = self._first
        if self.tables.size:
            behind = before + np.array([cols, rows])
            if (first >= before).all() and (end <= behind).all():
                return
            first = np.where(first < before, np.minimum(first, before - GROWTH_TILES), before)
            end = np.where(end > behind, np.maximum(end, behind + GROWTH_TILES), behind)
        width, height = end - first
        tables = np.zeros((particles, height, width), dtype=np.int32)
        left, below = before - first
        tables[:, below : below + rows, left : left + cols] = self.tables
        self.tables = tables
        self._first = first
        self.origin = first * side

    def register(self, poses: FloatArray, points: FloatArray) -> None:
        """Add end points (n, 2) [m], given in the robot frame, to each map at its particle's pose.

        Raises:
            SlamgymError: If the maps would take more memory than allowed.
        """
        particle = 0
        while True:
            particle = register_scan(plain(self.tile_maps), poses, points, particle)
            if particle == len(poses):
                return
            self._grow_pool(4 * len(points))

    def _grow_pool(self, needed: int) -> None:
        capacity = len(self.pool.references)
        num_bytes = sum(array.nbytes for array in self.pool)
        most = int(self._memory_limit * capacity / num_bytes)
        wanted = max(2 * capacity, capacity + 2 * needed)
        larger = min(wanted, most)
        if larger < capacity + needed:
            raise SlamgymError(
                f"the particles' maps need more than slam.memory_limit_mb={self._memory_limit / 1e6:.0f}; raise it, "
                "use fewer particles, or a coarser resolution"
            )
        self.pool = self.pool.grown(larger)

    def resample(self, ancestors: IntArray) -> None:
        """Give each particle the map of its ancestor, (particles,)."""
        copy_maps(self.pool, self.tables, ancestors)
