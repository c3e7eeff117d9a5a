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
from slamgym.gan.encoding import (
    decode_slam,
    enlarge_means,
    free_probability,
    resample_grey,
    resample_probability,
)
from slamgym.gan.networks.plain_unet import PlainUNet
from slamgym.gan.translation.elastic import drifted
from slamgym.gan.translation.finishing import thinned_walls
from slamgym.gan.translation.tiling import translate_tiled
from slamgym.gan.weights import (
    PRETRAINED_FOLDER,
    ModelCard,
    find_weights,
    load_tensors,
    load_weights,
)
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
        self,
        generate: Callable[[ByteArray], Float32Array],
        config: TranslatorConfig,
        card: ModelCard,
    ) -> None:
        """Take a generator.

        Args:
            generate: Turns maps (N, S, S) of its size into what it draws, (N, out, R, R) in [-1, 1].
            config: What it is.
            card: Where it comes from.
        """
        self.config = config
        self.card = card
        self._generate = generate

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
        floor, wall, door, _ = _shares(image)
        unseen = np.maximum(1.0 - floor - wall - door, 0.0)
        return MapLayers(floor, wall, door, unseen)

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
        straight = turned(padded, -angle)
        image = self._fitted(straight, UNKNOWN, metres_per_px)
        if angle and not straighten:
            shares = [turned_probability(channel, angle) for channel in _shares(image)]
            image = _encoded(np.stack(shares))
        rows, cols = slam.shape
        above, left = np.subtract(padded.shape, slam.shape) // 2
        return image[:, above : above + rows, left : left + cols]

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
            _, usual, _ = self.config.metres_per_px
            cells = drifted(cells, metres_per_px or usual, drift)
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
        channels = CHANNELS[self.config.output_encoding]
        result = np.full((channels, *cells.shape), -1.0, np.float32)
        rows, cols = _content(cells, empty)
        part = cells[rows, cols]
        if part.size == 0:
            return result
        shape = self._working_shape(part.shape, metres_per_px)
        resample = resample_slam if empty == UNKNOWN else resample_grey
        drawn = translate_tiled(resample(part, shape), self.config.input_size, empty, self._run)
        for channel, shares in enumerate(_shares(drawn)):
            result[channel, rows, cols] = _encoded(resample_probability(shares, part.shape))
        if self.config.direction == "slam2cad" and max(shape) > max(part.shape):
            self._close_walls(result[:, rows, cols], drawn)
        return result

    def _close_walls(self, image: Float32Array, drawn: Float32Array) -> None:
        """Close the walls that shrinking a drawing (C, h, w) to (C, H, W) has opened; their floor becomes wall."""
        encoding = self.config.output_encoding
        free = free_probability(image, encoding)
        row_ratio, col_ratio = np.divide(image.shape[1:], drawn.shape[1:])
        ratio = np.array([col_ratio, row_ratio])
        offset = 0.5 * ratio - 0.5
        matrix = np.column_stack([np.diag(ratio), offset])
        true_free = free_probability(drawn, encoding)
        closed = keep_thin_walls(free, true_free, matrix)
        opened = 2.0 * (free - closed)
        if encoding == "layers":
            image[1] += opened
            image = image[:1]
        np.maximum(image - opened, -1.0, out=image)

    def _working_shape(
        self, shape: tuple[int, ...], metres_per_px: float | None
    ) -> tuple[int, int]:
        """Rows and columns at which a map goes through the network."""
        size = self.config.input_size
        longest = max(shape)
        if metres_per_px is None:
            factor = max(size / longest, 1.0 / MAX_SHRINK)
        else:
            low, _, high = self.config.metres_per_px
            # The map's own scale if it was trained: every coarser one costs walls their place.
            factor = metres_per_px / min(max(metres_per_px, low), high)
        rows, cols = (max(1, min(math.ceil(side * factor), side * size)) for side in shape)
        if factor * longest <= size + 1:
            return min(rows, size), min(cols, size)
        return rows, cols

    def _run(self, tiles: ByteArray) -> Float32Array:
        """Translate tiles (N, S, S) to (N, C, S, S)."""
        images = self._generate(tiles)
        if images.shape[-1] == tiles.shape[-1]:
            return images
        count, channels, rows, cols = images.shape
        shares = _shares(images).reshape(-1, rows, cols)
        enlarged = np.stack([enlarge_means(image, tiles.shape[1:]) for image in shares])
        return _encoded(enlarged.reshape(count, channels, *tiles.shape[1:]))


def load_translator(
    name_or_path: str | Path = "slam2cad",
    direction: Direction | None = None,
    device: DeviceName = "cpu",
) -> LearnedTranslator:
    """Load a translator, ready to use; no network is needed, and for pretrained residual ones on the CPU no torch.

    Args:
        name_or_path: Pretrained weights (``slam2cad``, ...), a ``.safetensors`` file, or the folder of a finished run.
        direction: What it must translate; None takes any.
        device: Where to compute.

    Raises:
        InputFileError: If the file can't be used.
        ConfigError: If no such weights exist or they translate the other way.
    """
    path = find_weights(name_or_path)
    if device == "cpu" and path.parent == PRETRAINED_FOLDER:
        config, card, tensors = load_tensors(path, direction)
        if config.generator.kind == "residual":
            return LearnedTranslator(PlainUNet(tensors, config.generator.depth), config, card)
    from slamgym.gan.device import choose_compute
    from slamgym.gan.networks.factory import on_device

    weights = load_weights(path, direction)
    compute = choose_compute(device, "float32")
    generate = on_device(weights.generator, weights.config, compute)
    return LearnedTranslator(generate, weights.config, weights.card)


def _shares(images: Float32Array) -> Float32Array:
    """Values in [-1, 1] as shares in [0, 1]."""
    return 0.5 * (images + 1.0)


def _encoded(shares: Float32Array) -> Float32Array:
    """Shares in [0, 1] as values in [-1, 1]."""
    return 2.0 * shares - 1.0


def _require_image(cells: ByteArray) -> None:
    if cells.ndim != 2 or cells.dtype != np.uint8 or cells.size == 0:
        raise ConfigError(
            f"a map is an array (H, W) of uint8 that isn't empty, not {cells.dtype} of shape {cells.shape}"
        )


def _content(cells: ByteArray, empty: int) -> tuple[slice, slice]:
    """Rows and columns of what isn't empty, with a margin."""
    known = cells != empty
    rows = np.flatnonzero(known.any(axis=1)).tolist()
    cols = np.flatnonzero(known.any(axis=0)).tolist()
    if not rows:
        return slice(0, 0), slice(0, 0)
    height = rows[-1] - rows[0]
    width = cols[-1] - cols[0]
    margin = math.ceil(CONTENT_MARGIN * max(height, width) + 1)
    return _widened(rows, margin), _widened(cols, margin)


def _widened(indices: list[int], margin: int) -> slice:
    """From the first to the last of growing indices, and a margin around them; it may end beyond the image."""
    start = indices[0] - margin
    end = indices[-1] + margin + 1
    return slice(max(0, start), end)
