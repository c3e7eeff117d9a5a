"""The default generator for SLAM -> CAD: a residual U-Net that does its work at half resolution and below.

The input is folded 2 x 2 into channels at once, so the finest convolutions run at half the side, and the
output is unfolded again and refined by a thin pair of convolutions that sees the input's own pixels; its output is a
correction of the input. Skips are added, not concatenated.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional

from slamgym.gan.config import FOLD, GeneratorConfig
from slamgym.gan.networks.layers import GeneratorOutput

FINE_CHANNELS = 8
"""Channels at full resolution: few, since every one costs four of the level below."""
COPIED_LOG_ODDS = 2.0
"""Log odds that the untrained network gives to the input's first channel (free space, or grey): odds of 7."""
WIDENING = (1.0, 2.0, 3.0, 4.0, 4.0, 4.0, 4.0, 4.0)


class ResidualBlock(nn.Module):
    """Two convolutions beside a shortcut: (B, in, H, W) to (B, out, H, W)."""

    def __init__(self, inputs: int, outputs: int, dilation: int = 1) -> None:
        super().__init__()
        self.body = nn.Sequential(
            nn.Conv2d(inputs, outputs, 3, padding=dilation, dilation=dilation, bias=False),
            nn.BatchNorm2d(outputs),
            nn.ReLU(inplace=True),
            nn.Conv2d(outputs, outputs, 3, padding=1, bias=False),
            nn.BatchNorm2d(outputs),
        )
        self.shortcut: nn.Module = (
            nn.Identity() if inputs == outputs else nn.Conv2d(inputs, outputs, 1, bias=False)
        )

    def forward(self, features: Tensor) -> Tensor:
        """Add a correction to the features."""
        return functional.relu(self.body(features) + self.shortcut(features), inplace=True)


class ResidualUNet(nn.Module):
    """(B, in, S, S) to an output of the same size; S a multiple of FOLD * 2 ** depth."""

    def __init__(self, in_channels: int, out_channels: int, config: GeneratorConfig) -> None:
        super().__init__()
        self.depth = config.depth
        channels = [round(config.width * times / 8.0) * 8 or 8 for times in WIDENING[: self.depth + 1]]
        self.enter = nn.Sequential(
            nn.PixelUnshuffle(FOLD),
            nn.Conv2d(FOLD**2 * in_channels, channels[0], 3, padding=1, bias=False),
            nn.BatchNorm2d(channels[0]),
            nn.ReLU(inplace=True),
        )
        self.encode = nn.ModuleList(ResidualBlock(count, count) for count in channels)
        self.shrink = nn.ModuleList(
            nn.Conv2d(channels[level], channels[level + 1], 2, stride=2) for level in range(self.depth)
        )
        self.bottom = nn.Sequential(
            ResidualBlock(channels[-1], channels[-1], dilation=2),
            ResidualBlock(channels[-1], channels[-1], dilation=4),
        )
        self.widen = nn.ModuleList(
            nn.Conv2d(channels[level + 1], channels[level], 1, bias=False) for level in range(self.depth)
        )
        self.decode = nn.ModuleList(ResidualBlock(count, count) for count in channels[:-1])
        self.unfold = nn.Sequential(
            nn.Conv2d(channels[0], FOLD**2 * FINE_CHANNELS, 1), nn.PixelShuffle(FOLD), nn.ReLU(inplace=True)
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
            self.copy.weight[0, 0] = COPIED_LOG_ODDS

    def forward(self, x: Tensor, resolution: int | None = None, fade: float = 1.0) -> GeneratorOutput:
        """Translate.

        Args:
            x: (B, in, S, S) in [-1, 1].
            resolution: S or None; this network has one resolution.
            fade: Without effect, for the same reason.
        """
        side = x.shape[-1]
        if resolution not in (None, side) or fade < 1.0:
            raise ValueError(f"this generator works at the input's size {side} only, not at {resolution}")
        skips = [self.encode[0](self.enter(x))]  # (B, w, S / 2, S / 2)
        for level in range(self.depth):
            skips.append(self.encode[level + 1](self.shrink[level](skips[-1])))
        decoded = self.bottom(skips[-1])
        for level in range(self.depth - 1, -1, -1):
            below = functional.interpolate(self.widen[level](decoded), scale_factor=2.0, mode="nearest")
            decoded = self.decode[level](below + skips[level])
        fine = self.unfold(decoded)  # (B, FINE_CHANNELS, S, S)
        correction = self.refine(torch.cat([fine, x.to(fine.dtype)], dim=1))
        logits = correction.float() + self.copy(x).float()
        return GeneratorOutput(torch.tanh(0.5 * logits), logits)
