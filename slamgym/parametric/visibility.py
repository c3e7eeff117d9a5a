"""The area that the robot saw along its path: the only part of the map that SLAM can draw."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import BoolArray, FloatArray, GridFrame, Int32Array
from slamgym.parametric.config import ScannerView


class SeenCells(NamedTuple):
    """Which scans saw which cells; cells are flat indices ``row * width + col``."""

    first: Int32Array  # (H, W) first scan that saw the cell, -1 never
    last: Int32Array  # (H, W) last scan that saw it, -1 never
    best: Int32Array  # (H, W) nearest scan that saw the wall cell, -1 for no wall or unseen
    hits: Int32Array  # (T, B) wall cell that each beam met, -1 for none


@kernel
def observe_cells(
    occupied: BoolArray,
    sensors: FloatArray,
    angles: FloatArray,
    range_min_px: float,
    range_max_px: float,
    seen: SeenCells,
) -> None:
    """Cast every beam of every scan and keep a record per cell.

    Convention: sensor poses are in cells: ``sensors[k] = (col, row, heading)`` with continuous coordinates
    (cell ``[i, j]`` covers col in [j, j + 1), row in [i, i + 1)), row growing downwards, heading
    counter-clockwise in the world as always.

    Args:
        occupied: (H, W); a beam ends in the first occupied cell after the sensor's own or at the edge of
            the grid.
        sensors: (T, 3).
        angles: (B,) beam directions in the sensor frame [rad].
        range_min_px: Walls nearer than this give no hit [cells].
        range_max_px: Longest beam [cells].
        seen: Out; -1 before.
    """
    first, last, best, hits = seen
    height, width = occupied.shape
    for k in range(sensors.shape[0]):
        x0 = sensors[k, 0]
        y0 = sensors[k, 1]
        for b in range(angles.shape[0]):
            hits[k, b] = -1
            direction = sensors[k, 2] + angles[b]
            dx = math.cos(direction)
            dy = -math.sin(direction)
            col = math.floor(x0)
            row = math.floor(y0)
            step_col = 1 if dx > 0.0 else -1
            step_row = 1 if dy > 0.0 else -1
            # Along the beam: from one border of columns or rows to the next, and to the first.
            per_col = math.inf
            per_row = math.inf
            next_col = math.inf
            next_row = math.inf
            if dx != 0.0:
                to_border = col + 1 - x0 if dx > 0.0 else x0 - col
                per_col = 1.0 / abs(dx)
                next_col = to_border * per_col
            if dy != 0.0:
                to_border = row + 1 - y0 if dy > 0.0 else y0 - row
                per_row = 1.0 / abs(dy)
                next_row = to_border * per_row
            travelled = 0.0
            while travelled <= range_max_px and 0 <= row < height and 0 <= col < width:
                if last[row, col] != k:
                    last[row, col] = k
                    if first[row, col] < 0:
                        first[row, col] = k
                if occupied[row, col] and travelled > 0.0:
                    if travelled >= range_min_px:
                        hits[k, b] = row * width + col
                        j = best[row, col]
                        mid_col = col + 0.5
                        mid_row = row + 0.5
                        if j < 0 or (
                            math.hypot(mid_col - x0, mid_row - y0)
                            < math.hypot(mid_col - sensors[j, 0], mid_row - sensors[j, 1])
                        ):
                            best[row, col] = k
                    break
                if next_col < next_row:
                    travelled = next_col
                    next_col += per_col
                    col += step_col
                else:
                    travelled = next_row
                    next_row += per_row
                    row += step_row


@dataclass(frozen=True)
class Visibility:
    """A record of who saw what; scans are numbered along the trajectory."""

    frame: GridFrame
    sensors: FloatArray  # (T, 3) true poses of the scanner, world frame
    cells: SeenCells
    mount_x: float  # [m] of the scanner ahead of the base

    @property
    def seen(self) -> BoolArray:
        """Cells that some scan saw, shape (H, W)."""
        return self.cells.first >= 0

    def cell_points(self, cells: Int32Array) -> FloatArray:
        """Centres (N, 2) [m] of flat cell indices (N,), world frame."""
        rows, cols = np.divmod(cells, self.frame.width_px)
        return self.frame.to_points(rows, cols)


def beam_angles(scanner: ScannerView, resolution: float) -> FloatArray:
    """Beam directions in the sensor frame, shape (B,) [rad], symmetric about the heading."""
    view = float(scanner.field_of_view)
    num = scanner.num_beams or math.ceil(view * scanner.range_max / resolution)
    beams = np.arange(num, dtype=np.float64)
    if view >= 2.0 * math.pi - 1e-9:  # a full circle has no two ends
        return np.asarray(view / num * beams - math.pi, dtype=np.float64)
    return np.asarray(view / (num - 1) * beams - 0.5 * view, dtype=np.float64)


def observe(
    occupied: BoolArray, frame: GridFrame, poses: FloatArray, scanner: ScannerView
) -> Visibility:
    """Cast the scans of a trajectory on a raster.

    Convention: ``poses`` are in the frame that ``frame`` places the raster in.

    Args:
        occupied: (H, W) wall cells.
        frame: Where the cells lie.
        poses: (T, 3) poses of the robot's base.
        scanner: Field of view and range.
    """
    sensors = poses.copy()
    sensors[:, 0] += scanner.mount_x * np.cos(poses[:, 2])
    sensors[:, 1] += scanner.mount_x * np.sin(poses[:, 2])
    x, y, heading = sensors.T
    # In cells, rows growing downwards.
    across = (x - frame.origin_x) / frame.resolution
    down = frame.height_px - (y - frame.origin_y) / frame.resolution
    angles = beam_angles(scanner, frame.resolution)
    cells = SeenCells(
        first=np.full(frame.shape, -1, dtype=np.int32),
        last=np.full(frame.shape, -1, dtype=np.int32),
        best=np.full(frame.shape, -1, dtype=np.int32),
        hits=np.empty((len(poses), len(angles)), dtype=np.int32),
    )
    observe_cells(
        np.ascontiguousarray(occupied),
        np.column_stack([across, down, heading]),
        angles,
        scanner.range_min / frame.resolution,
        scanner.range_max / frame.resolution,
        cells,
    )
    return Visibility(frame, sensors, cells, scanner.mount_x)
