"""The default generator for SLAM -> CAD: a residual U-Net that does its work at half resolution and below.

The input is folded 2 x 2 (or 4 x 4) into channels at once, so the finest convolutions run at half the side, and the
output is unfolded again and refined by a thin pair of convolutions that sees the input's own pixels; what it draws is a
correction of the input. Skips are added, not concatenated. With ``displacement`` the decoder first predicts, at an
eighth of the side, how far each place drifted, and the finer skips (and the input) are warped back by it before they
are used.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional

from slamgym.gan.networks.displacement import resize_field, warp
from slamgym.gan.networks.layers import GeneratorOutput

FINE_CHANNELS = 8
"""Channels at full resolution: few, since every one costs four of the level below."""
COPIED_LOG_ODDS = 2.0
"""Log odds that the untrained network gives to the input's first channel (free space, or grey): odds of 7."""
FIELD_LEVEL = 2
"""The field is predicted at this level: an eighth of the input's side (a sixteenth with ``fold`` 4)."""
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
    """(B, in, S, S) to a drawing of the same size; S a multiple of fold * 2 ** depth."""

    def __init__(
        self,
        in_channels: int,
        out_channels: int,
        width: int = 24,
        depth: int = 4,
        displacement: bool = False,
        max_displacement_px: float = 8.0,
        fold: int = 2,
    ) -> None:
        super().__init__()
        self.depth = depth
        self.max_displacement_px = max_displacement_px
        channels = [round(width * WIDENING[level] / 8.0) * 8 or 8 for level in range(depth + 1)]
        self.enter = nn.Sequential(
            nn.PixelUnshuffle(fold),
            nn.Conv2d(fold**2 * in_channels, channels[0], 3, padding=1, bias=False),
            nn.BatchNorm2d(channels[0]),
            nn.ReLU(inplace=True),
        )
        self.encode = nn.ModuleList(ResidualBlock(count, count) for count in channels)
        self.shrink = nn.ModuleList(
            nn.Conv2d(channels[level], channels[level + 1], 2, stride=2) for level in range(depth)
        )
        self.bottom = nn.Sequential(
            ResidualBlock(channels[-1], channels[-1], dilation=2),
            ResidualBlock(channels[-1], channels[-1], dilation=4),
        )
        self.widen = nn.ModuleList(
            nn.Conv2d(channels[level + 1], channels[level], 1, bias=False) for level in range(depth)
        )
        self.decode = nn.ModuleList(ResidualBlock(count, count) for count in channels[:-1])
        self.unfold = nn.Sequential(
            nn.Conv2d(channels[0], fold**2 * FINE_CHANNELS, 1), nn.PixelShuffle(fold), nn.ReLU(inplace=True)
        )
        self.refine = nn.Sequential(
            nn.Conv2d(FINE_CHANNELS + in_channels, FINE_CHANNELS, 3, padding=1),
            nn.ReLU(inplace=True),
            nn.Conv2d(FINE_CHANNELS, out_channels, 3, padding=1),
        )
        self.copy = nn.Conv2d(in_channels, out_channels, 1, bias=False)
        field_level = min(FIELD_LEVEL, depth)
        self.field_head = nn.Conv2d(channels[field_level], 2, 3, padding=1) if displacement else None
        self.field_level = field_level

    def start(self, generator: torch.Generator) -> None:
        """Draw the weights anew: He's normal (2015); blocks start as the identity (their last gain is 0).

        Args:
            generator: Source of the draws.
        """
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, nonlinearity="relu", generator=generator)
                if module.bias is not None:
                    nn.init.zeros_(module.bias)
        for block in self.modules():
            if isinstance(block, ResidualBlock):
                last = block.body[-1]
                assert isinstance(last, nn.BatchNorm2d)
                nn.init.zeros_(last.weight)
        # The first drawing is the input: only what is wrong with it has to be learnt.
        nn.init.zeros_(self.copy.weight)
        with torch.no_grad():
            self.copy.weight[0, 0] = COPIED_LOG_ODDS
        last_conv = self.refine[-1]
        assert isinstance(last_conv, nn.Conv2d)
        nn.init.zeros_(last_conv.weight)
        if self.field_head is not None:
            nn.init.zeros_(self.field_head.weight)
            assert self.field_head.bias is not None
            nn.init.zeros_(self.field_head.bias)

    def forward(self, x: Tensor, resolution: int | None = None, fade: float = 1.0) -> GeneratorOutput:
        """Draw.

        Args:
            x: (B, in, S, S) in [-1, 1].
            resolution: S or None; this network has one resolution.
            fade: Without effect, for the same reason.
        """
        side = x.shape[-1]
        if resolution not in (None, side) or fade < 1.0:
            raise ValueError(f"this generator draws at the input's size {side} only, not at {resolution}")
        skips = [self.encode[0](self.enter(x))]  # (B, w, S / fold, S / fold)
        for level in range(self.depth):
            skips.append(self.encode[level + 1](self.shrink[level](skips[-1])))
        drawn = self.bottom(skips[-1])
        field: Tensor | None = None
        if self.field_level == self.depth:
            field = self._predict_field(drawn)
        for level in range(self.depth - 1, -1, -1):
            skip = skips[level] if field is None else self._undo(skips[level], field, side)
            below = functional.interpolate(self.widen[level](drawn), scale_factor=2.0, mode="nearest")
            drawn = self.decode[level](below + skip)
            if level == self.field_level:
                field = self._predict_field(drawn)
        seen = x if field is None else self._undo(x, field, side)
        fine = self.unfold(drawn)  # (B, FINE_CHANNELS, S, S)
        correction = self.refine(torch.cat([fine, seen.to(fine.dtype)], dim=1))
        logits = correction.float() + self.copy(seen).float()
        return GeneratorOutput(torch.tanh(0.5 * logits), logits, field)

    def _predict_field(self, features: Tensor) -> Tensor | None:
        if self.field_head is None:
            return None
        return self.max_displacement_px * torch.tanh(self.field_head(features).float())

    @staticmethod
    def _undo(features: Tensor, field: Tensor, input_size: int) -> Tensor:
        return warp(features, resize_field(field, features.shape[-1], input_size))
