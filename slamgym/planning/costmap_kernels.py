"""Kernels of the costmap: the ground under the robot, distances to obstacles, and what cells cost."""

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import BoolArray, ByteArray, Float32Array, FloatArray, Int32Array, IntArray

_OCCUPIED = np.uint8(0)
_FREE = np.uint8(254)
_LETHAL = np.uint8(254)
_NO_INFORMATION = np.uint8(255)


@kernel
def clear_body(cells: ByteArray, row: int, col: int, radius_px: float, core_px: float) -> None:
    """Free the cells under the robot: unknown ones within ``radius_px``, all within ``core_px``."""
    half = int(radius_px) + 1
    for r in range(max(0, row - half), min(cells.shape[0], row + half + 1)):
        for c in range(max(0, col - half), min(cells.shape[1], col + half + 1)):
            squared = (r - row) ** 2 + (c - col) ** 2
            unknown = cells[r, c] != _OCCUPIED and cells[r, c] != _FREE
            if squared <= core_px**2 or (unknown and squared <= radius_px**2):
                cells[r, c] = _FREE


@kernel
def cost_cells(cells: ByteArray, distance_px: Float32Array, table: ByteArray) -> ByteArray:
    """Costs, shape (H, W), from the distance to the nearest occupied cell.

    Args:
        cells: ROS map values, shape (H, W).
        distance_px: Distance between centres of a cell and the nearest occupied one, shape (H, W) [cells].
        table: Cost by squared distance [cells^2]; the last entry holds for all that is farther.
    """
    height, width = cells.shape
    costs = np.empty((height, width), np.uint8)
    limit = np.float32(len(table) - 1)
    for row in range(height):
        for col in range(width):
            if cells[row, col] == _OCCUPIED:
                costs[row, col] = _LETHAL
            elif cells[row, col] == _FREE:
                squared = distance_px[row, col] * distance_px[row, col] + np.float32(0.5)
                costs[row, col] = table[int(squared)] if squared < limit else table[-1]
            else:
                costs[row, col] = _NO_INFORMATION
    return costs


@kernel
def clear_beams(
    cells: ByteArray,
    x: float,
    y: float,
    theta: float,
    ranges: Float32Array,
    angle_min: float,
    angle_increment: float,
    longest: float,
    margin: float,
) -> None:
    """Free the occupied cells that the beams of a scan passed, but for the last stretch of each beam.

    Args:
        cells: ROS map values, shape (H, W); changed in place.
        x: Sensor [cells], column of cell centres.
        y: Sensor [cells], row of cell centres.
        theta: Sensor's heading [rad], counter-clockwise; rows grow downwards.
        ranges: Shape (num_beams,) [cells].
        angle_min: Direction of the first beam in the sensor's frame [rad].
        angle_increment: Angle from one beam to the next [rad].
        longest: Beams are cut off here [cells].
        margin: What is kept at the end of each beam [cells]: errors of the pose must not erase real walls.
    """
    height, width = cells.shape
    for i in range(len(ranges)):
        if not ranges[i] > 0.0:
            continue
        end = min(ranges[i], longest) - margin
        angle = theta + angle_min + i * angle_increment
        dx, dy = np.cos(angle), -np.sin(angle)
        step = 0.0
        while step < end:
            row, col = int(np.floor(y + step * dy + 0.5)), int(np.floor(x + step * dx + 0.5))
            if 0 <= row < height and 0 <= col < width and cells[row, col] == _OCCUPIED:
                cells[row, col] = _FREE
            step += 0.5


@kernel
def stand_apart(
    cells: ByteArray, rows: IntArray, cols: IntArray, resolution: float, apart: float
) -> BoolArray:
    """Which of some cells are farther than ``apart`` from every occupied one, shape (N,).

    Args:
        cells: ROS map values, shape (H, W).
        rows: Of the cells asked about, shape (N,).
        cols: The same.
        resolution: Cell size [m].
        apart: Between the centres of two cells [m].
    """
    height, width = cells.shape
    half = int(apart / resolution) + 1
    is_apart = np.ones(len(rows), np.bool_)
    for i in range(len(rows)):
        for row in range(max(0, rows[i] - half), min(height, rows[i] + half + 1)):
            for col in range(max(0, cols[i] - half), min(width, cols[i] + half + 1)):
                if cells[row, col] == _OCCUPIED:
                    squared = np.float32((row - rows[i]) ** 2 + (col - cols[i]) ** 2)
                    # In single precision, as distance fields are.
                    if not np.sqrt(squared) * np.float32(resolution) > np.float32(apart):
                        is_apart[i] = False
    return is_apart


@kernel
def distance_to_occupied(cells: ByteArray) -> Float32Array:
    """Exact Euclidean distance of each cell to the nearest occupied one, shape (H, W) [cells]; 1e6 without any.

    First the distance along the column, then, row by row, the lower envelope of the parabolas
    ``(col - c)^2 + along_column[c]^2`` (Felzenszwalb and Huttenlocher 2012). Where two parabolas meet on a cell
    either may be taken, so the rounding of their intersection does no harm.

    Args:
        cells: ROS map values, shape (H, W).
    """
    height, width = cells.shape
    far = height + width
    along_column = np.empty((height, width), np.int32)
    for col in range(width):
        along_column[0, col] = 0 if cells[0, col] == _OCCUPIED else far
    for row in range(1, height):
        for col in range(width):
            step = min(along_column[row - 1, col] + 1, far)
            along_column[row, col] = 0 if cells[row, col] == _OCCUPIED else step
    for row in range(height - 2, -1, -1):
        for col in range(width):
            along_column[row, col] = min(along_column[row, col], along_column[row + 1, col] + 1)
    distance = np.empty((height, width), np.float32)
    apex, lift, first = np.empty((3, width), np.int32)
    half_inverse = 0.5 / np.arange(0.0, width)
    for row in range(height):
        count = _lower_envelope(along_column[row], far, half_inverse, apex, lift, first)
        end = width
        for k in range(count - 1, -1, -1):
            height_2 = lift[k] - apex[k] ** 2
            for col in range(first[k], end):
                distance[row, col] = np.sqrt(np.float32((col - apex[k]) ** 2 + height_2))
            end = first[k]
        if count == 0:
            distance[row] = 1e6
    return distance


@kernel
def _lower_envelope(
    along_column: Int32Array,
    far: int,
    half_inverse: FloatArray,
    apex: Int32Array,
    lift: Int32Array,
    first: Int32Array,
) -> int:
    """The parabolas of a row that are lowest somewhere, from left to right; returns their number.

    Args:
        along_column: Distance along the column, shape (W,) [cells]; ``far`` where it holds no occupied cell.
        far: See above.
        half_inverse: ``1 / (2 n)`` for each n, shape (W,).
        apex: Receives the column of each parabola, shape (W,).
        lift: Receives ``along_column^2 + apex^2``, shape (W,).
        first: Receives the first column where it is the lowest, shape (W,).
    """
    count = 0
    for col in range(len(along_column)):
        if along_column[col] >= far:
            continue
        lifted = along_column[col] ** 2 + col**2
        begin = 0
        while count > 0:
            top = np.uint64(count - 1)  # an unsigned index isn't asked whether it counts from the end
            meeting = (lifted - lift[top]) * half_inverse[np.uint64(col - apex[top])]
            begin = int(meeting) + 1 if meeting >= 0.0 else 0
            if begin > first[top]:
                break
            count -= 1
            begin = 0
        if begin < len(along_column):
            apex[count], lift[count], first[count] = col, lifted, begin
            count += 1
    return count
