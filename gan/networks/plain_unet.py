"""The trained residual U-Net in NumPy: importing torch takes longer than translating the map of a home.

Batch norms are part of the convolutions before them. Its images are those of
:class:`~slamgym.gan.networks.generators.ResidualUNet` but for the order of sums, some 1e-6.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from slamgym.core.types import ByteArray, Float32Array
from slamgym.gan.config import FOLD
from slamgym.gan.encoding import MAX_OCCUPIED_GREY, MIN_FREE_GREY

_VARIANCE_FLOOR = 1e-5
"""What torch's batch norm adds to variances."""
_AT_ONCE = 1 << 18
"""So many values are multiplied at once, which the processor's cache holds: 0.7 of the time of all together."""


class _Convolution(NamedTuple):
    weight: Float32Array  # (out, in, side, side)
    bias: Float32Array  # (out,)


class PlainUNet:
    """Translates maps that are encoded as ``free_occupied`` to layers."""

    def __init__(self, tensors: Mapping[str, np.ndarray], depth: int) -> None:
        """Take the weights of a file.

        Args:
            tensors: Those of :class:`~slamgym.gan.networks.generators.ResidualUNet`, by their names.
            depth: Its halvings.
        """
        self._tensors = {name: np.asarray(array, np.float32) for name, array in tensors.items()}
        self._enter = self._normed("enter.1", "enter.2")
        self._encode = [self._block(f"encode.{level}") for level in range(depth + 1)]
        self._bottom = [self._block("bottom.0"), self._block("bottom.1")]
        self._decode = [self._block(f"decode.{level}") for level in range(depth)]

    def __call__(self, cells: ByteArray) -> Float32Array:
        """Translate maps (N, S, S) to layers (N, 4, S, S) in [-1, 1]."""
        return np.stack([self._translated(tile) for tile in cells])

    def _translated(self, cells: ByteArray) -> Float32Array:
        """Translate a map (S, S) to layers (4, S, S) in [-1, 1]."""
        shown = np.stack([cells >= MIN_FREE_GREY, cells <= MAX_OCCUPIED_GREY])
        image = 2.0 * shown.astype(np.float32) - 1.0
        features = _rectified(_convolved(_folded(image), self._enter))
        skips = [_corrected(features, self._encode[0])]
        for level, block in enumerate(self._encode[1:]):
            shrunk = self._mixed(_folded(skips[-1]), f"shrink.{level}")
            skips.append(_corrected(shrunk, block))
        decoded = _corrected(skips[-1], self._bottom[0], dilation=2)
        decoded = _corrected(decoded, self._bottom[1], dilation=4)
        for level in reversed(range(len(self._decode))):
            below = self._mixed(decoded, f"widen.{level}")
            doubled = below.repeat(2, axis=1).repeat(2, axis=2)
            decoded = _corrected(doubled + skips[level], self._decode[level])
        fine = _rectified(_unfolded(self._mixed(decoded, "unfold.0")))
        seen = np.concatenate([fine, image])
        refined = _rectified(_convolved(seen, self._plain("refine.0")))
        logits = _convolved(refined, self._plain("refine.2")) + self._mixed(image, "copy")
        odds = np.exp(logits - logits.max(axis=0))
        return 2.0 * odds / odds.sum(axis=0) - 1.0

    def _plain(self, name: str) -> _Convolution:
        """A convolution; the bias of some is none."""
        weight = self._tensors[f"{name}.weight"]
        none = np.zeros(len(weight), np.float32)
        return _Convolution(weight, self._tensors.get(f"{name}.bias", none))

    def _normed(self, convolution: str, norm: str) -> _Convolution:
        """A convolution and the batch norm behind it as one."""
        weight, bias = self._plain(convolution)
        spread = np.sqrt(self._tensors[f"{norm}.running_var"] + _VARIANCE_FLOOR)
        gain = self._tensors[f"{norm}.weight"] / spread
        shift = (bias - self._tensors[f"{norm}.running_mean"]) * gain
        total = shift + self._tensors[f"{norm}.bias"]
        return _Convolution(weight * gain[:, None, None, None], total)

    def _block(self, name: str) -> tuple[_Convolution, _Convolution]:
        """The two convolutions of a residual block."""
        first = self._normed(f"{name}.body.0", f"{name}.body.1")
        return first, self._normed(f"{name}.body.3", f"{name}.body.4")

    def _mixed(self, features: Float32Array, name: str) -> Float32Array:
        """A convolution of single pixels, or of squares that are folded: (C, H, W) to (out, H, W)."""
        weight, bias = self._plain(name)
        return _convolved(features, _Convolution(weight.reshape(len(bias), -1, 1, 1), bias))


def _corrected(
    features: Float32Array, block: tuple[_Convolution, _Convolution], dilation: int = 1
) -> Float32Array:
    """Features through a residual block."""
    first, second = block
    inner = _rectified(_convolved(features, first, dilation))
    return _rectified(_convolved(inner, second) + features)


def _rectified(features: Float32Array) -> Float32Array:
    """Without negative values, in place."""
    return np.maximum(features, 0.0, out=features)


def _folded(features: Float32Array) -> Float32Array:
    """Squares of pixels as channels: (C, H, W) to (C FOLD^2, H / FOLD, W / FOLD)."""
    count, rows, cols = features.shape
    squares = features.reshape(count, rows // FOLD, FOLD, cols // FOLD, FOLD)
    return squares.transpose(0, 2, 4, 1, 3).reshape(-1, rows // FOLD, cols // FOLD)


def _unfolded(features: Float32Array) -> Float32Array:
    """The inverse of :func:`_folded`."""
    _, rows, cols = features.shape
    squares = features.reshape(-1, FOLD, FOLD, rows, cols)
    return squares.transpose(0, 3, 1, 4, 2).reshape(-1, FOLD * rows, FOLD * cols)


def _convolved(
    features: Float32Array, convolution: _Convolution, dilation: int = 1
) -> Float32Array:
    """A convolution with a border of zeros: (C, H, W) to (out, H, W).

    Its pixels lie in one long row, border included, so that each of the weights' places is a shift of that row.
    """
    count, rows, cols = features.shape
    side = convolution.weight.shape[-1]
    padding = dilation * (side // 2)
    row = cols + 2 * padding
    # One row more: the last shift leaves the picture by the width of its border.
    padded = np.zeros((count, rows + 2 * padding + 1, row), np.float32)
    padded[:, padding : padding + rows, padding : padding + cols] = features
    long = padded.reshape(count, -1)
    shifts = [dilation * (down * row + right) for down in range(side) for right in range(side)]
    matrix = convolution.weight.transpose(0, 2, 3, 1).reshape(len(convolution.bias), -1)
    result = np.empty((len(matrix), rows * row), np.float32)
    step = _AT_ONCE // matrix.shape[1]
    for first in range(0, rows * row, step):
        end = min(first + step, rows * row)
        shifted = np.concatenate([long[:, first + shift : end + shift] for shift in shifts])
        np.matmul(matrix, shifted, out=result[:, first:end])
    result += convolution.bias[:, None]
    return result.reshape(-1, rows, row)[:, :, :cols]
