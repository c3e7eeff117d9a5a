"""What the particles own: maps made of shared tiles, and paths that share their past (GMapping's trajectory tree)."""

import math

import numpy as np

from slamgym.core.errors import SlamgymError
from slamgym.core.jit import kernel, plain
from slamgym.core.types import OCCUPIED, FloatArray, IntArray, OccupancyGrid
from slamgym.slam.tiles import BYTES_PER_TILE, TILE, TileMaps, TilePool, copy_maps, drop_maps, register_scan


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
        self._parents[self._length, : len(poses)] = self._pending
        self._poses[self._length, : len(poses)] = poses
        self._stamps[self._length] = stamp
        self._ranges[self._length] = ranges
        self._pending = np.arange(poses.shape[0])
        self._length += 1

    def resample(self, ancestors: IntArray) -> None:
        """Note which particle each place descends from, after the last processed scan."""
        self._pending = self._pending[ancestors]

    def replace_poses(self, poses: FloatArray) -> None:
        """Put the only particle's path elsewhere, (steps, 3)."""
        self._poses[: self._length, 0] = poses

    def poses_along(self, lineage: IntArray, first: int = 0) -> FloatArray:
        """Poses, shape (steps - first, 3), along a lineage from step ``first``."""
        steps = np.arange(first, self._length)
        along: FloatArray = self._poses[steps, lineage[steps]]
        return along


FIRST_TILES = 1024
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
        self._corner = (0, 0)  # tile (row, col) of the lattice where the tables begin
        self.origin: FloatArray = np.zeros(2)
        self._memory_limit = memory_limit_mb * 1e6

    @property
    def tile_maps(self) -> TileMaps:
        """The maps as the kernels take them, until the next change of the pool or the tables."""
        return TileMaps(self.pool, self.tables, self.origin, self.resolution)

    @property
    def num_bytes(self) -> int:
        """Memory of the maps."""
        return len(self.pool.references) * BYTES_PER_TILE + self.tables.nbytes

    def cover(self, poses: FloatArray, radius: float) -> None:
        """Let the tables cover all points within ``radius`` [m] of the poses (particles, 3)."""
        side = TILE * self.resolution
        low = [math.floor((value - radius) / side) for value in poses[:, :2].min(axis=0).tolist()]
        high = [math.floor((value + radius) / side) + 1 for value in poses[:, :2].max(axis=0).tolist()]
        row, col = self._corner
        _, rows, cols = self.tables.shape
        if rows and low[1] >= row and low[0] >= col and high[1] <= row + rows and high[0] <= col + cols:
            return
        first_row, first_col, last_row, last_col = low[1], low[0], high[1], high[0]
        if rows:
            first_row = row if first_row >= row else min(first_row, row - GROWTH_TILES)
            first_col = col if first_col >= col else min(first_col, col - GROWTH_TILES)
            last_row = row + rows if last_row <= row + rows else max(last_row, row + rows + GROWTH_TILES)
            last_col = col + cols if last_col <= col + cols else max(last_col, col + cols + GROWTH_TILES)
        tables = np.zeros((len(self.tables), last_row - first_row, last_col - first_col), dtype=np.int32)
        tables[:, row - first_row : row - first_row + rows, col - first_col : col - first_col + cols] = (
            self.tables
        )
        self.tables, self._corner = tables, (first_row, first_col)
        self.origin = np.array([first_col, first_row], dtype=np.float64) * (TILE * self.resolution)

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
        most = int(self._memory_limit / BYTES_PER_TILE)
        larger = min(max(2 * capacity, capacity + 2 * needed), most)
        if larger < capacity + needed:
            raise SlamgymError(
                f"the particles' maps need more than slam.memory_limit_mb={self._memory_limit / 1e6:.0f}; raise it, "
                "use fewer particles, or a coarser resolution"
            )
        self.pool = self.pool.grown(larger)

    def add_known(self, grid: OccupancyGrid) -> None:
        """Take the occupied cells of an older map for end points that every particle has seen."""
        rows, cols = np.nonzero(grid.cells == OCCUPIED)
        min_x, min_y, max_x, max_y = grid.frame.bounds
        middle = np.array([0.5 * (min_x + max_x), 0.5 * (min_y + max_y), 0.0])
        points = np.column_stack(grid.frame.to_point(rows, cols)) - middle[:2]
        poses = np.tile(middle, (len(self.tables), 1))
        self.cover(poses, 0.5 * max(max_x - min_x, max_y - min_y) + grid.frame.resolution)
        self.register(poses, points)

    def resample(self, ancestors: IntArray) -> None:
        """Give each of so many particles the map of its ancestor."""
        before, after = len(self.tables), len(ancestors)
        if after > before:
            self.tables = np.concatenate(
                [self.tables, np.zeros_like(self.tables[:1]).repeat(after - before, 0)]
            )
        copy_maps(self.pool, self.tables, ancestors)
        if after < before:
            drop_maps(self.pool, self.tables[after:])
            self.tables = self.tables[:after].copy()
