"""Use a trained translator: maps of any size and scale in, maps of the same frame out.

How an image reaches the network: a SLAM map is turned so that most walls lie along the axes, cut to what is known
of it, and resampled to a scale at which the network was trained (given by the ROS map's resolution; without it the
map is fitted into the network's image). What is larger than the network's image goes through in overlapping tiles. The
translation is resampled and turned back, so that it lies over the input.
"""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np

from slamgym.core.errors import ConfigError
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, ByteArray, Float32Array
from slamgym.gan.config import CHANNELS, DeviceName, Direction, TranslatorConfig
from slamgym.gan.device import Compute, choose_compute
from slamgym.gan.encoding import (
    decode_slam,
    enlarge_means,
    free_probability,
    resample_grey,
    resample_probability,
)
from slamgym.gan.networks.factory import TRANSLATION_BATCH, Generator, run_generator
from slamgym.gan.translation.elastic import drifted
from slamgym.gan.translation.finishing import thinned_walls
from slamgym.gan.weights import ModelCard, load_weights
from slamgym.metrics.layers import MapLayers
from slamgym.metrics.maps import keep_thin_walls, resample_slam
from slamgym.metrics.wall_direction import (
    MAX_DRIFT_DEG,
    MIN_TURN_DEG,
    angle_to_undo_deg,
    padded_for_turning,
    turned,
    turned_probability,
)

OVERLAP = 0.25
"""Least share of a tile that its neighbour sees too."""


def tile_starts(length: int, tile: int) -> list[int]:
    """Where tiles begin along one axis so that they cover it evenly, the last one ending at its end."""
    if length <= tile:
        return [0]
    count = int(np.ceil((length - tile * OVERLAP) / (tile * (1.0 - OVERLAP))))
    return [round(start) for start in np.linspace(0, length - tile, count)]


def translate_tiled(
    cells: ByteArray, tile: int, fill: int, run: Callable[[ByteArray], Float32Array]
) -> Float32Array:
    """Translate tile by tile.

    Args:
        cells: (H, W), any size; smaller sides are padded in the middle.
        tile: Side of a tile.
        fill: Value of the padding.
        run: Turns tiles (N, tile, tile) into (N, C, tile, tile).

    Returns:
        (C, H, W): the mean of the tiles, weighted less towards their borders; -1 where a tile would be empty.
    """
    rows, cols = cells.shape
    above, beside = max(0, tile - rows) // 2, max(0, tile - cols) // 2
    below, behind = max(0, tile - rows) - above, max(0, tile - cols) - beside
    padded = np.pad(cells, ((above, below), (beside, behind)), constant_values=fill)
    corners = [
        (r, c)
        for r in tile_starts(padded.shape[0], tile)
        for c in tile_starts(padded.shape[1], tile)
    ]
    corners = [(r, c) for r, c in corners if (padded[r : r + tile, c : c + tile] != fill).any()]
    window = _window(tile)
    total: Float32Array | None = None
    weight = np.full(padded.shape, 1e-9, np.float32)
    # Some at a time, so that only the result grows with the map.
    for first in range(0, len(corners), TRANSLATION_BATCH):
        some = corners[first : first + TRANSLATION_BATCH]
        images = run(np.stack([padded[r : r + tile, c : c + tile] for r, c in some]))
        if total is None:  # nothing where nothing is known
            total = np.full((images.shape[1], *padded.shape), -1e-9, np.float32)
        for (r, c), part in zip(some, images, strict=True):
            total[:, r : r + tile, c : c + tile] += part * window
            weight[r : r + tile, c : c + tile] += window
    if total is None:
        return np.full((1, rows, cols), -1.0, np.float32)
    blended: Float32Array = (total / weight).astype(np.float32)
    return blended[:, above : above + rows, beside : beside + cols]


def _window(tile: int) -> Float32Array:
    """Weights that fall towards the borders but stay positive."""
    ramp = np.minimum(np.arange(tile), np.arange(tile)[::-1]) + 1.0
    ramp = np.minimum(1.0, ramp / (OVERLAP * tile))
    return np.asarray(np.outer(ramp, ramp), dtype=np.float32)


@runtime_checkable
class Translator(Protocol):
    """Something that turns a SLAM map into a map of where the floor is."""

    def translate(self, slam: ByteArray, metres_per_px: float | None = None) -> Float32Array:
        """For each pixel the probability of being free space of the building.

        Args:
            slam: SLAM map, shape (H, W): 0 occupied, 205 unknown, 254 free, row 0 at the top. Any size.
            metres_per_px: Scale of the map [m], if it is known.

        Returns:
            Shape (H, W), values in [0, 1], in the frame and scale of ``slam``: 1 inside of rooms, 0 in walls
            and outside. A threshold of 0.5 gives the CAD map.
        """
        ...


CONTENT_MARGIN = 0.06
"""Border around what is known of a map, in shares of its larger side."""
MAX_SHRINK = 4.0
"""A map of unknown scale is shrunk at most by this to fit into the network's image; a larger one is tiled."""


class LearnedTranslator:
    """A trained generator; satisfies :class:`Translator` if it gives CAD maps."""

    def __init__(
        self, generator: Generator, config: TranslatorConfig, card: ModelCard, compute: Compute
    ) -> None:
        """Put the generator on a device.

        Args:
            generator: In evaluation mode.
            config: What it is.
            card: Where it comes from.
            compute: Device and precision.
        """
        self.config = config
        self.card = card
        self._compute = compute
        self._generator = compute.put(generator)

    def translate(
        self,
        slam: ByteArray,
        metres_per_px: float | None = None,
        straighten: bool = False,
        angle_deg: float | None = None,
    ) -> Float32Array:
        """For each pixel of a SLAM map the probability of being free space of the building.

        Args:
            slam: (H, W): 0 occupied, 205 unknown, 254 free, row 0 at the top.
            metres_per_px: Scale of the map, if it is known.
            straighten: Leave the CAD map turned about the image's centre so that most walls lie along the axes,
                instead of turning it back into the map's frame.
            angle_deg: Direction of most walls, counter-clockwise from the image's rows; None finds it.

        Returns:
            (H, W) in [0, 1]: 1 inside of rooms, 0 in walls and outside.

        Raises:
            ConfigError: If these weights translate to SLAM maps, or the map is empty.
        """
        image = self._drawn(slam, metres_per_px, straighten, angle_deg)
        return free_probability(image, self.config.output_encoding)

    def layers(
        self, slam: ByteArray, metres_per_px: float | None = None, angle_deg: float | None = None
    ) -> MapLayers:
        """The layers of a SLAM map; arguments and errors as of :meth:`translate`.

        Raises:
            ConfigError: Also if these weights draw no layers.
        """
        if self.config.output_encoding != "layers":
            raise ConfigError(
                "these weights draw floor alone, no layers; choose others with --weights"
            )
        image = self._drawn(slam, metres_per_px, False, angle_deg)
        floor, wall, door = 0.5 * (image[:3] + 1.0)
        return MapLayers(floor, wall, door, np.maximum(1.0 - floor - wall - door, 0.0))

    def _drawn(
        self,
        slam: ByteArray,
        metres_per_px: float | None,
        straighten: bool,
        angle_deg: float | None,
    ) -> Float32Array:
        """What the network draws of a SLAM map, (C, H, W) in [-1, 1]."""
        if self.config.direction != "slam2cad":
            raise ConfigError(
                "these weights translate CAD maps to SLAM maps; choose others with --weights"
            )
        _require_image(slam)
        angle = angle_to_undo_deg(slam) if angle_deg is None else angle_deg
        if not self.config.derotate or abs(angle) < MIN_TURN_DEG:
            angle = 0.0
        # A small turn cuts nothing off but a sliver of the corners; the training's maps are turned like this, too.
        padded = slam if abs(angle) <= MAX_DRIFT_DEG else padded_for_turning(slam, angle)
        image = self._fitted(turned(padded, -angle), UNKNOWN, metres_per_px)
        above, beside = ((a - b) // 2 for a, b in zip(padded.shape, slam.shape, strict=True))
        if not straighten:
            image = np.stack(
                [2.0 * turned_probability(0.5 * (c + 1.0), angle) - 1.0 for c in image]
            )
        return image[:, above : above + slam.shape[0], beside : beside + slam.shape[1]]

    def translate_cells(
        self,
        cells: ByteArray,
        metres_per_px: float | None = None,
        straighten: bool = False,
        drift: np.random.Generator | None = None,
    ) -> ByteArray:
        """Translate a map into the other kind of map, in either direction.

        Args:
            cells: (H, W): a SLAM map (0, 205, 254) or a CAD map (0, 254), row 0 at the top.
            metres_per_px: Scale of the map, if it is known.
            straighten: As in :meth:`translate`; without effect on CAD maps.
            drift: Bend a CAD map by a random field first, as drift would: one CAD map then gives many SLAM maps.
                Without effect on SLAM maps.

        Returns:
            (H, W): a CAD map (0, 254) or a SLAM map (0, 205, 254), in the same frame.
        """
        if self.config.direction == "slam2cad":
            free = self.translate(cells, metres_per_px, straighten)
            return np.where(free >= 0.5, FREE, OCCUPIED).astype(np.uint8)
        _require_image(cells)
        if drift is not None:
            cells = drifted(cells, metres_per_px or self.config.metres_per_px[1], drift)
        image = self._fitted(cells, OCCUPIED, metres_per_px)
        # Drawn at the network's resolution a wall is as thick as its pixel, several cells of the map.
        return thinned_walls(decode_slam(image, self.config.output_encoding))

    def _fitted(self, cells: ByteArray, empty: int, metres_per_px: float | None) -> Float32Array:
        """Translate at the network's scale: (C, H, W) of the input's size in [-1, 1], -1 where nothing is known.

        Args:
            cells: (H, W).
            empty: Value of what isn't known (SLAM) or outside (CAD).
            metres_per_px: Scale, if it is known.
        """
        size = self.config.input_size
        result = np.full((CHANNELS[self.config.output_encoding], *cells.shape), -1.0, np.float32)
        rows, cols = _content(cells, empty)
        part = cells[rows, cols]
        if part.size == 0:
            return result
        shape = self._working_shape(part.shape, metres_per_px)
        resampled = resample_slam(part, shape) if empty == UNKNOWN else resample_grey(part, shape)
        drawn = translate_tiled(resampled, size, empty, self._run)
        for channel, image in enumerate(drawn):
            result[channel, rows, cols] = (
                2.0 * resample_probability(0.5 * (image + 1.0), part.shape) - 1.0
            )
        if self.config.direction == "slam2cad" and max(shape) > max(part.shape):
            self._close_walls(result[:, rows, cols], drawn)
        return result

    def _close_walls(self, image: Float32Array, drawn: Float32Array) -> None:
        """Close the walls that shrinking a drawing (C, h, w) to (C, H, W) has opened; their floor becomes wall."""
        encoding = self.config.output_encoding
        free = free_probability(image, encoding)
        ratio = np.divide(image.shape[1:], drawn.shape[1:])[::-1]
        matrix = np.column_stack([np.diag(ratio), 0.5 * ratio - 0.5])
        opened = 2.0 * (free - keep_thin_walls(free, free_probability(drawn, encoding), matrix))
        if encoding == "layers":
            image[1] += opened
            image = image[:1]
        np.maximum(image - opened, -1.0, out=image)

    def _working_shape(
        self, shape: tuple[int, ...], metres_per_px: float | None
    ) -> tuple[int, int]:
        """Rows and columns at which a map goes through the network."""
        size, longest = self.config.input_size, max(shape)
        if metres_per_px is None:
            factor = max(size / longest, 1.0 / MAX_SHRINK)
        else:
            low, _, high = self.config.metres_per_px
            # The map's own scale if it was trained: every coarser one costs walls their place.
            factor = metres_per_px / min(max(metres_per_px, low), high)
        rows, cols = (max(1, min(math.ceil(side * factor), side * size)) for side in shape)
        return (min(rows, size), min(cols, size)) if factor * longest <= size + 1 else (rows, cols)

    def _run(self, tiles: ByteArray) -> Float32Array:
        """Translate tiles (N, S, S) to (N, C, S, S)."""
        size, resolution = tiles.shape[-1], self.config.output_size
        images = run_generator(self._generator, tiles, self.config, self._compute, resolution)
        if images.shape[-1] == size:
            return images
        shares = [[enlarge_means(0.5 * (c + 1.0), (size, size)) for c in image] for image in images]
        return 2.0 * np.array(shares, dtype=np.float32) - 1.0


def load_translator(
    name_or_path: str | Path = "slam2cad",
    direction: Direction | None = None,
    device: DeviceName = "cpu",
) -> LearnedTranslator:
    """Load a translator, ready to use; no network is needed.

    Args:
        name_or_path: Pretrained weights (``slam2cad``, ...), a ``.safetensors`` file, or the folder of a finished run.
        direction: What it must translate; None takes any.
        device: Where to compute.

    Raises:
        InputFileError: If the file can't be used.
        ConfigError: If no such weights exist or they translate the other way.
    """
    weights = load_weights(name_or_path, direction)
    return LearnedTranslator(
        weights.generator, weights.config, weights.card, choose_compute(device, "float32")
    )


def _require_image(cells: ByteArray) -> None:
    if cells.ndim != 2 or cells.dtype != np.uint8 or cells.size == 0:
        raise ConfigError(
            f"a map is an array (H, W) of uint8 that isn't empty, not {cells.dtype} of shape {cells.shape}"
        )


def _content(cells: ByteArray, empty: int) -> tuple[slice, slice]:
    """Rows and columns of what isn't empty, with a margin."""
    known = cells != empty
    rows, cols = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    if rows.size == 0:
        return slice(0, 0), slice(0, 0)
    margin = math.ceil(CONTENT_MARGIN * max(rows[-1] - rows[0], cols[-1] - cols[0]) + 1)
    # A slice may end beyond the image.
    top, left = max(0, int(rows[0]) - margin), max(0, int(cols[0]) - margin)
    return slice(top, int(rows[-1]) + margin + 1), slice(left, int(cols[-1]) + margin + 1)
