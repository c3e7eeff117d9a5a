"""Cells of a map drawn in four passes, each given those before: an exact likelihood without a discriminator.

A trunk looks once at what error-free scans counted. A light head then draws an eighth of the cells, another eighth, a
quarter and the rest, spread evenly by a Bayer matrix, each pass independently given the trunk and the cells that are
drawn already (multiscale PixelCNN: Reed et al., *Parallel Multiscale Autoregressive Density Estimation*, 2017).
"""

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from slamgym.core.config import Count, Settings
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN

CLASSES = (OCCUPIED, UNKNOWN, FREE)
"""Classes in their order."""
FOLD = 2
"""Blocks of 2 x 2 cells become channels: a quarter of the places, nothing lost."""
COUNTED = 3
"""What error-free scans counted (``parametric.robot_scans.texture_channels``)."""
_BAYER = np.array([[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]])
_PASS_ENDS = (2, 4, 8, 16)  # of the 16 places of a Bayer matrix
PASSES = len(_PASS_ENDS)


class TextureConfig(Settings):
    """Size of the network."""

    width: Count = 32
    """Channels of the trunk."""
    dilations: tuple[int, ...] = (1, 2, 4, 2, 1)
    """Of the trunk's convolutions, in blocks of two cells."""
    styles: Count = 6
    """Numbers that describe mapper and laser (``parametric.robot_scans.style_of``)."""


def pass_numbers(height: int, width: int, shift: tuple[int, int] = (0, 0)) -> np.ndarray:
    """In which pass each cell is drawn, (height, width) uint8.

    Args:
        height: Rows.
        width: Columns.
        shift: Rows and columns by which the pattern begins later.
    """
    rows, cols = (np.arange(n) + s for n, s in zip((height, width), shift, strict=True))
    order = _BAYER[rows[:, None] % 4, cols % 4]
    return np.searchsorted(_PASS_ENDS, order, side="right").astype(np.uint8)


class TextureNetwork(nn.Module):
    """Trunk and head.

    Args:
        config: The sizes.
    """

    def __init__(self, config: TextureConfig) -> None:
        super().__init__()
        self.config = config
        width, blocks = config.width, FOLD**2
        self.entry = nn.Conv2d(COUNTED * blocks, width, 3, padding=1)
        self.style = nn.Linear(config.styles, width)
        self.body = nn.ModuleList(nn.Conv2d(width, width, 3, padding=d, dilation=d) for d in config.dilations)
        self.join = nn.Conv2d(width + (len(CLASSES) + 1) * blocks, width, 3, padding=1)
        self.mix = nn.Conv2d(width, width, 3, padding=1)
        self.exit = nn.Conv2d(width, len(CLASSES) * blocks, 1)

    def trunk(self, counted: Tensor, style: Tensor) -> Tensor:
        """Features of what was counted (N, 3, H, W), both sides even, in a style (N, styles)."""
        features = self.entry(functional.pixel_unshuffle(counted, FOLD))
        features = functional.silu(features + self.style(style)[:, :, None, None])
        for convolution in self.body:
            features = features + functional.silu(convolution(features))
        return features

    def head(self, features: Tensor, drawn: Tensor, known: Tensor) -> Tensor:
        """Logits (N, 3, H, W) of every cell.

        Args:
            features: From :meth:`trunk`.
            drawn: Classes of the cells that are drawn, as channels of 0 and 1, 0 elsewhere, (N, 3, H, W).
            known: 1 where a cell is drawn, (N, 1, H, W).
        """
        seen = functional.pixel_unshuffle(torch.cat([drawn, known], dim=1), FOLD)
        features = functional.silu(self.join(torch.cat([features, seen.to(features.dtype)], dim=1)))
        features = features + functional.silu(self.mix(features))
        return functional.pixel_shuffle(self.exit(features), FOLD)

    def loss(self, counted: Tensor, style: Tensor, classes: Tensor, passes: Tensor) -> Tensor:
        """Mean negative log-likelihood of maps [nat a cell].

        Args:
            counted: (N, 3, H, W).
            style: (N, styles).
            classes: (N, H, W) int64, indices of ``CLASSES``.
            passes: (H, W), in which pass each cell is drawn.
        """
        features = self.trunk(counted, style)
        of_class = functional.one_hot(classes, len(CLASSES)).permute(0, 3, 1, 2).to(counted.dtype)
        total = torch.zeros((), device=counted.device)
        for number in range(PASSES):
            known = (passes < number).to(counted.dtype).expand(len(counted), 1, *passes.shape)
            logits = self.head(features, of_class * known, known).float()
            now = passes == number
            total = total + functional.cross_entropy(logits[:, :, now], classes[:, now], reduction="sum")
        return total / classes.numel()
