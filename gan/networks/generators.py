"""The paper's generator: a U-Net whose decoder grows, with an output head at every resolution.

The network of anime2clothing (Tango et al., arXiv 2008.11479) as it is coded. With ``width`` 32 and an input of 256 px:

======  =====  ===========    =======  =====  =====================
encoder  side  channels       decoder   side  skip + below -> out
======  =====  ===========    =======  =====  =====================
enter     256  in -> 32       grow[0]      4  128 (no skip) -> 128
down[0]   128  32 -> 64       grow[1]      8  128 + 128 -> 128
down[1]    64  64 -> 64       grow[2]     16  128 + 128 -> 128
down[2]    32  64 -> 64       grow[3]     32  128 + 128 -> 64
down[3]    16  64 -> 128      grow[4]     64  64 + 64 -> 64
down[4]     8  128 -> 128     grow[5]    128  64 + 64 -> 64
down[5]     4  128 -> 128     grow[6]    256  64 + 64 -> 32
down[6]     2  128 -> 128
======  =====  ===========    =======  =====  =====================

A skip joins before the doubling, so it comes from the encoder level one size below the output; the finest encoder
feature is never a skip. The network is deterministic: no dropout, no noise input.

The default one for SLAM -> CAD is a residual U-Net that does its work at half resolution and below: the input is folded
2 x 2 into channels at once, and the output is unfolded again and refined by a thin pair of convolutions that sees the
input's own pixels; its output is a correction of the input. Skips are added, not concatenated.
"""

from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from slamgym.gan.config import FOLD, GeneratorConfig

INNERMOST_SIDE = 2
"""Side of the innermost feature [px]."""
FINE_CHANNELS = 8
"""Channels at full resolution: few, since every one costs four of the level below."""
COPIED_LOG_ODDS = 2.0
"""Log odds that the untrained network gives to floor where the input is free, and to walls where it is occupied."""
WIDENING = (1.0, 2.0, 3.0, 4.0, 4.0, 4.0, 4.0, 4.0)
"""Channels of each level of the residual U-Net, in multiples of ``width``."""
LEAK = 0.2
"""Slope of the leaky rectifiers (anime2clothing)."""


class GeneratorOutput(NamedTuple):
    """The output of a generator."""

    image: Tensor  # (B, out, R, R) in [-1, 1]
    logits: Tensor | None = None
    """Of layers, so that ``image = 2 softmax(logits) - 1``; same shape. None of images that are no layers."""


class DoubleConv(nn.Sequential):
    """Twice convolution 3 x 3, batch norm, leaky rectifier: (B, in, H, W) to (B, out, H, W)."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__(
            nn.Conv2d(inputs, outputs, 3, padding=1, bias=False),
            nn.BatchNorm2d(outputs),
            nn.LeakyReLU(LEAK),
            nn.Conv2d(outputs, outputs, 3, padding=1, bias=False),
            nn.BatchNorm2d(outputs),
            nn.LeakyReLU(LEAK),
        )


def halve(images: Tensor) -> Tensor:
    """Mean of 2 x 2 pixels: (B, C, H, W) to (B, C, H / 2, W / 2)."""
    return functional.avg_pool2d(images, 2)


def double(images: Tensor) -> Tensor:
    """Repeat each pixel 2 x 2: (B, C, H, W) to (B, C, 2 H, 2 W)."""
    return functional.interpolate(images, scale_factor=2.0, mode="nearest")


def blend(new: Tensor, old: Tensor, fade: float) -> Tensor:
    """The mixture while a resolution fades in: ``fade`` 0 is all old, 1 all new."""
    return new if fade >= 1.0 else torch.lerp(old, new, fade)


class ProgressiveGenerator(nn.Module):
    """Gives images of any of its resolutions for an input of one size."""

    def __init__(
        self, in_channels: int, out_channels: int, input_size: int = 256, width: int = 32
    ) -> None:
        super().__init__()
        self.input_size = input_size
        self.halvings = (input_size // INNERMOST_SIDE).bit_length() - 1  # 7 for 256 px
        encoder = self._encoder_channels(width)
        decoder = self._decoder_channels(width)
        self.enter = DoubleConv(in_channels, width)
        self.down = nn.ModuleList(
            DoubleConv(encoder[level], encoder[level + 1]) for level in range(self.halvings)
        )
        self.grow = nn.ModuleList()
        for step in range(self.halvings):
            skip = encoder[self.halvings - step] if step > 0 else 0
            self.grow.append(DoubleConv(skip + decoder[step], decoder[step + 1]))
        self.heads = nn.ModuleList(
            nn.Conv2d(channels, out_channels, 1, bias=False) for channels in decoder[1:]
        )

    def _encoder_channels(self, width: int) -> list[int]:
        """Of each level: level i has side input_size / 2**i, and those from the fourth halving on are wide."""
        narrow = min(3, self.halvings)
        wide = self.halvings - narrow
        return [width] + [2 * width] * narrow + [4 * width] * wide

    def _decoder_channels(self, width: int) -> list[int]:
        """Of the innermost feature and of each step, which doubles the side."""
        channels = [4 * width]
        for step in range(1, self.halvings):
            is_coarse = INNERMOST_SIDE << step < self.input_size // 8
            channels.append(4 * width if is_coarse else 2 * width)
        channels.append(width)
        return channels

    def forward(
        self, x: Tensor, resolution: int | None = None, fade: float = 1.0
    ) -> GeneratorOutput:
        """Translate.

        Args:
            x: (B, in, input_size, input_size) in [-1, 1].
            resolution: Side of the output, a power of two from 4 to ``input_size``; None takes ``input_size``.
            fade: Share of this resolution's head while it fades in; the rest is the doubled output of the head
                before.
        """
        last = self._step_of(self.input_size if resolution is None else resolution)
        features = [self.enter(x)]  # (B, 32, 256, 256)
        for block in self.down:
            features.append(block(halve(features[-1])))  # ... (B, 128, 2, 2)
        decoded = self.grow[0](double(features[-1]))  # (B, 128, 4, 4)
        coarser = decoded
        for step in range(1, last + 1):
            coarser = decoded
            skip = features[self.halvings - step]
            joined = torch.cat([skip, decoded], dim=1)
            decoded = self.grow[step](double(joined))
        scores: Tensor = self.heads[last](decoded).float()  # (B, out, resolution, resolution)
        image = torch.tanh(scores)
        if fade < 1.0 and last > 0:
            old_scores = self.heads[last - 1](coarser).float()
            old = torch.tanh(old_scores)
            image = blend(image, double(old), fade)
        return GeneratorOutput(image)

    def _step_of(self, resolution: int) -> int:
        step = (resolution // INNERMOST_SIDE).bit_length() - 2
        if resolution != INNERMOST_SIDE << (step + 1) or not 0 <= step < self.halvings:
            raise ValueError(
                f"resolution {resolution} isn't a power of two from 4 to {self.input_size}"
            )
        return step


class ResidualBlock(nn.Module):
    """Two convolutions with a shortcut: (B, C, H, W) to the same."""

    def __init__(self, channels: int, dilation: int = 1) -> None:
        super().__init__()
        self.body = nn.Sequential(
            nn.Conv2d(channels, channels, 3, padding=dilation, dilation=dilation, bias=False),
            nn.BatchNorm2d(channels),
            nn.ReLU(inplace=True),
            nn.Conv2d(channels, channels, 3, padding=1, bias=False),
            nn.BatchNorm2d(channels),
        )

    def forward(self, features: Tensor) -> Tensor:
        """Add a correction to the features."""
        return functional.relu(self.body(features) + features, inplace=True)


class ResidualUNet(nn.Module):
    """(B, in, S, S) to an output of the same size; S a multiple of FOLD * 2 ** depth."""

    def __init__(self, in_channels: int, out_channels: int, config: GeneratorConfig) -> None:
        super().__init__()
        self.depth = config.depth
        channels = []
        for times in WIDENING[: self.depth + 1]:
            eights = round(config.width * times / 8.0)
            channels.append(max(8, 8 * eights))
        self.enter = nn.Sequential(
            nn.PixelUnshuffle(FOLD),
            nn.Conv2d(FOLD**2 * in_channels, channels[0], 3, padding=1, bias=False),
            nn.BatchNorm2d(channels[0]),
            nn.ReLU(inplace=True),
        )
        self.encode = nn.ModuleList(ResidualBlock(count) for count in channels)
        self.shrink = nn.ModuleList(
            nn.Conv2d(channels[level], channels[level + 1], 2, stride=2)
            for level in range(self.depth)
        )
        self.bottom = nn.Sequential(
            ResidualBlock(channels[-1], dilation=2), ResidualBlock(channels[-1], dilation=4)
        )
        self.widen = nn.ModuleList(
            nn.Conv2d(channels[level + 1], channels[level], 1, bias=False)
            for level in range(self.depth)
        )
        self.decode = nn.ModuleList(ResidualBlock(count) for count in channels[:-1])
        self.unfold = nn.Sequential(
            nn.Conv2d(channels[0], FOLD**2 * FINE_CHANNELS, 1),
            nn.PixelShuffle(FOLD),
            nn.ReLU(inplace=True),
        )
        self.refine = nn.Sequential(
            nn.Conv2d(FINE_CHANNELS + in_channels, FINE_CHANNELS, 3, padding=1),
            nn.ReLU(inplace=True),
            nn.Conv2d(FINE_CHANNELS, out_channels, 3, padding=1),
        )
        self.copy = nn.Conv2d(in_channels, out_channels, 1, bias=False)

    def start(self, generator: torch.Generator) -> None:
        """Initialise the weights: He's normal (2015); blocks start as the identity (their last gain is 0).

        Args:
            generator: Source of the draws.
        """
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, nonlinearity="relu", generator=generator)
                if module.bias is not None:
                    nn.init.zeros_(module.bias)
        # The first output is the input: only what is wrong with it has to be learnt.
        zero = ("copy.", "refine.2.weight")
        with torch.no_grad():
            for name, values in self.named_parameters():
                if name.startswith(zero) or name.endswith("body.4.weight"):
                    values.zero_()
            for layer in range(min(2, self.copy.in_channels)):  # free to floor, occupied to wall
                self.copy.weight[layer, layer] = COPIED_LOG_ODDS

    def forward(
        self, x: Tensor, resolution: int | None = None, fade: float = 1.0
    ) -> GeneratorOutput:
        """Translate.

        Args:
            x: (B, in, S, S) in [-1, 1].
            resolution: S or None; this network has one resolution.
            fade: Without effect, for the same reason.
        """
        side = x.shape[-1]
        if resolution not in (None, side) or fade < 1.0:
            raise ValueError(
                f"this generator works at the input's size {side} only, not at {resolution}"
            )
        entered = self.enter(x)
        skips = [self.encode[0](entered)]  # (B, w, S / 2, S / 2)
        for level in range(self.depth):
            shrunk = self.shrink[level](skips[-1])
            skips.append(self.encode[level + 1](shrunk))
        decoded = self.bottom(skips[-1])
        for level in range(self.depth - 1, -1, -1):
            below = double(self.widen[level](decoded))
            decoded = self.decode[level](below + skips[level])
        fine = self.unfold(decoded)  # (B, FINE_CHANNELS, S, S)
        seen = torch.cat([fine, x.to(fine.dtype)], dim=1)
        correction = self.refine(seen).float()
        copied = self.copy(x).float()
        logits = correction + copied
        shares = torch.softmax(logits, dim=1)
        return GeneratorOutput(2.0 * shares - 1.0, logits)
