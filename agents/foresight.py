"""A network that completes the map about the robot: floor and walls that lie beyond the frontier, and its doubt.

A U-Net (Ronneberger, Fischer and Brox, MICCAI 2015) on shares of free and of occupied cells. Its doubt comes from
dropout: the same few masks every time, so that the same map is foreseen alike (Gal and Ghahramani, ICML 2016). It runs
without torch; ``benchmarks/exploring/foresight.py`` trains it. That predicted maps help exploration: Shrestha et
al., "Learned map prediction for enhanced mobile robot exploration", ICRA 2019.
"""

import functools
import math
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from slamgym.core.geometry import paste
from slamgym.core.portable import exp, product
from slamgym.core.provenance import check_origin
from slamgym.core.types import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    Float32Array,
    FloatArray,
    GridFrame,
    OccupancyGrid,
    Pose2D,
)
from slamgym.planning.exploration_loop import ExplorationLoop

WEIGHTS = Path(__file__).parent / "pretrained" / "foresight.safetensors"
"""The network that comes with the package."""

FORESIGHT_CELL = 0.2
"""Size of its cells [m]."""
WINDOW_PX = 64
"""Side of the window about the robot that it completes [cells]: 12.8 m."""
LEVEL_CHANNELS = (8, 16, 32, 64)
"""Channels of its levels."""
DROPOUT = (0.2, 0.2, 0.2, 0.1)
"""Shares of channels left out in training: before the lowest level, and at the levels on the way up."""

_MEMBERS = 3
_RANGE = 3.0  # so far a scan shows what it is taken to show [m]
_RAYS = 48
_POCKET = 5.0  # what is foreseen farther from a frontier isn't its own [m]


class Foreseen(NamedTuple):
    """The network's expectation about the robot."""

    floor: Float32Array  # (members, n, n) share of each cell that is unseen floor the robot can get to
    wall: Float32Array  # (members, n, n) probability of a wall
    frame: GridFrame  # of the window, map frame


class ExpectedArea(NamedTuple):
    """New floor that candidates are expected to bring [m2]; means and standard deviations over the members."""

    in_sight: FloatArray  # (N,) what a look round from the frontier shows
    in_sight_doubt: FloatArray  # (N,)
    pocket: FloatArray  # (N,) all that is nearest to this frontier
    pocket_doubt: FloatArray  # (N,)


class MapCompletion:
    """The network.

    Args:
        weights: Arrays by the names of the network's parameters.
    """

    def __init__(self, weights: Mapping[str, Float32Array]) -> None:
        self._weights = {name: np.ascontiguousarray(value, np.float32) for name, value in weights.items()}
        rng = np.random.default_rng(0)
        ups = [
            below + level for below, level in zip(LEVEL_CHANNELS[:0:-1], LEVEL_CHANNELS[-2::-1], strict=True)
        ]
        widths = (LEVEL_CHANNELS[-2], *ups)
        self._masks = [
            [
                ((rng.random((width, 1, 1)) >= share) / (1.0 - share)).astype(np.float32)
                for width, share in zip(widths, DROPOUT, strict=True)
            ]
            for _ in range(_MEMBERS)
        ]

    def complete(self, grid: OccupancyGrid, pose: Pose2D) -> Foreseen:
        """Complete a map about the robot.

        Args:
            grid: The map, at 0.05 m a cell.
            pose: The robot in its frame.
        """
        shares, frame = window_about(grid, pose)
        skips = []
        values = shares
        for level in range(len(LEVEL_CHANNELS) - 1):
            values = self._block(f"down.{level}", _halved(values) if level else values)
            skips.append(values)
        lowest = _halved(values)
        drawn = np.stack([self._member(lowest, skips, masks) for masks in self._masks])
        likely: Float32Array = (1.0 / (1.0 + exp(-drawn))).astype(np.float32)
        return Foreseen(likely[:, 0], likely[:, 1], frame)

    def _member(
        self, lowest: Float32Array, skips: list[Float32Array], masks: list[Float32Array]
    ) -> Float32Array:
        """Output of the network with some channels left out, logits of shape (2, n, n)."""
        values = self._block(f"down.{len(LEVEL_CHANNELS) - 1}", lowest * masks[0])
        for level, (skip, mask) in enumerate(zip(reversed(skips), masks[1:], strict=True)):
            doubled = values.repeat(2, axis=1).repeat(2, axis=2)
            values = self._block(f"up.{level}", np.concatenate([doubled, skip]) * mask)
        logits = product(self._weights["out.weight"].reshape(2, -1), values.reshape(len(values), -1))
        return logits.reshape(2, *values.shape[1:]) + self._weights["out.bias"][:, None, None]

    def _block(self, name: str, values: Float32Array) -> Float32Array:
        return self._convolved(f"{name}.1", self._convolved(f"{name}.0", values))

    def _convolved(self, name: str, values: Float32Array) -> Float32Array:
        """A 3 x 3 convolution and a rectifier."""
        channels, height, width = values.shape
        padded = np.pad(values, ((0, 0), (1, 1), (1, 1)))
        columns = np.empty((channels, 9, height, width), np.float32)
        for index in range(9):
            row, col = divmod(index, 3)
            columns[:, index] = padded[:, row : row + height, col : col + width]
        weight = self._weights[f"{name}.weight"]
        drawn = product(weight.reshape(len(weight), -1), columns.reshape(channels * 9, -1))
        drawn += self._weights[f"{name}.bias"][:, None]
        return np.maximum(drawn, 0.0, out=drawn).reshape(-1, height, width)


@functools.cache
def pretrained_completion() -> MapCompletion:
    """The network that comes with the package."""
    from safetensors.numpy import load_file

    check_origin(WEIGHTS)
    return MapCompletion(load_file(WEIGHTS))


def window_about(grid: OccupancyGrid, pose: Pose2D) -> tuple[Float32Array, GridFrame]:
    """Shares of free and of occupied cells about the robot, shape (2, WINDOW_PX, WINDOW_PX), and their frame."""
    fine = grid.frame
    ratio = round(FORESIGHT_CELL / fine.resolution)
    left = math.floor(pose.x / FORESIGHT_CELL) * FORESIGHT_CELL - 0.5 * WINDOW_PX * FORESIGHT_CELL
    bottom = math.floor(pose.y / FORESIGHT_CELL) * FORESIGHT_CELL - 0.5 * WINDOW_PX * FORESIGHT_CELL
    frame = GridFrame(FORESIGHT_CELL, left, bottom, WINDOW_PX, WINDOW_PX)
    size = WINDOW_PX * ratio
    top = round((fine.origin_y + fine.height_px * fine.resolution - bottom) / fine.resolution) - size
    first = round((left - fine.origin_x) / fine.resolution)
    cells = np.full((size, size), UNKNOWN, np.uint8)
    paste(cells, grid.cells, top, first)
    shares = np.stack([cells == FREE, cells == OCCUPIED]).astype(np.float32)
    return shares.reshape(2, WINDOW_PX, ratio, WINDOW_PX, ratio).mean(axis=(2, 4)), frame


def expected_areas(foreseen: Foreseen, points: FloatArray) -> ExpectedArea:
    """New floor that is expected at frontiers.

    Args:
        foreseen: What the network expects.
        points: Middles of the frontiers, map frame, shape (N, 2) [m]. Beyond the window nothing is foreseen.
    """
    row, col = foreseen.frame.to_cell(points[:, 0], points[:, 1])
    cells = np.column_stack([row, col]).astype(np.float64)
    sight = _in_sight(foreseen, cells)
    pocket = _pockets(foreseen, cells)
    return ExpectedArea(sight.mean(axis=0), sight.std(axis=0), pocket.mean(axis=0), pocket.std(axis=0))


def foresee(loop: ExplorationLoop) -> ExpectedArea:
    """Expectation of the pretrained network for a loop's candidates."""
    foreseen = pretrained_completion().complete(loop.known_map(), loop.pose)
    return expected_areas(foreseen, np.array([one.frontier.middle for one in loop.candidates]).reshape(-1, 2))


def _in_sight(foreseen: Foreseen, cells: FloatArray) -> FloatArray:
    """Floor that rays from cells (N, 2) pass over until they meet a wall, shape (members, N) [m2]."""
    angles = 2.0 * np.pi * np.arange(_RAYS) / _RAYS
    radii = np.arange(1, round(_RANGE / FORESIGHT_CELL) + 1)
    steps = radii[:, None] * np.stack([np.sin(angles), np.cos(angles)])[:, None]  # (2, radii, rays)
    at = np.round(cells[:, :, None, None] + steps[None]).astype(np.int64)
    inside = ((at >= 0) & (at < WINDOW_PX)).all(axis=1)
    rows, cols = np.clip(at[:, 0], 0, WINDOW_PX - 1), np.clip(at[:, 1], 0, WINDOW_PX - 1)
    floor = np.where(inside, foreseen.floor[:, rows, cols], 0.0)
    through = np.cumprod(1.0 - np.where(inside, foreseen.wall[:, rows, cols], 1.0), axis=2)
    ring = radii[:, None] * (2.0 * np.pi / _RAYS) * FORESIGHT_CELL**2
    return (floor * through * ring).sum(axis=(2, 3))


def _pockets(foreseen: Foreseen, cells: FloatArray) -> FloatArray:
    """Floor that is nearest to each of some cells (N, 2), shape (members, N) [m2]."""
    rows, cols = np.nonzero(foreseen.floor.max(axis=0) > 0.05)
    areas = np.zeros((len(foreseen.floor), len(cells)))
    if len(rows) == 0 or len(cells) == 0:
        return areas
    apart = np.hypot(rows[:, None] - cells[None, :, 0], cols[:, None] - cells[None, :, 1])
    owner = apart.argmin(axis=1)
    near = apart.min(axis=1) <= _POCKET / FORESIGHT_CELL
    for member, floor in enumerate(foreseen.floor[:, rows, cols]):
        shares = np.bincount(owner[near], weights=floor[near], minlength=len(cells))
        areas[member] = shares * FORESIGHT_CELL**2
    return areas


def _halved(values: Float32Array) -> Float32Array:
    """The largest of each 2 x 2 cells."""
    channels, height, width = values.shape
    return values.reshape(channels, height // 2, 2, width // 2, 2).max(axis=(2, 4))
