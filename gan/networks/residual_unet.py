"""The default generator for SLAM -> CAD: a residual U-Net that does its work at half resolution and below.

The input is folded 2 x 2 (or 4 x 4) into channels at once, so the finest convolutions run at half the side, and the
output is unfolded again and refined by a thin pair of convolutions that sees the input's own pixels; its output is a
correction of the input. Skips are added, not concatenated. With ``displacement`` the decoder first predicts, at an
eighth of the side, how far each place drifted, and the finer skips (and the input) are warped back by it before they
are used.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional

from slamgym.gan.config import GeneratorConfig
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
    """(B, in, S, S) to an output of the same size; S a multiple of fold * 2 ** depth."""

    def __init__(self, in_channels: int, out_channels: int, config: GeneratorConfig) -> None:
        super().__init__()
        self.depth, fold = config.depth, config.fold
        self.max_displacement_px = config.max_displacement_px
        channels = [round(config.width * times / 8.0) * 8 or 8 for times in WIDENING[: self.depth + 1]]
        self.enter = nn.Sequential(
            nn.PixelUnshuffle(fold),
            nn.Conv2d(fold**2 * in_channels, channels[0], 3, padding=1, bias=False),
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
            nn.Conv2d(channels[0], fold**2 * FINE_CHANNELS, 1), nn.PixelShuffle(fold), nn.ReLU(inplace=True)
        )
        self.refine = nn.Sequential(
            nn.Conv2d(FINE_CHANNELS + in_channels, FINE_CHANNELS, 3, padding=1),
            nn.ReLU(inplace=True),
            nn.Conv2d(FINE_CHANNELS, out_channels, 3, padding=1),
        )
        self.copy = nn.Conv2d(in_channels, out_channels, 1, bias=False)
        self.field_level = min(FIELD_LEVEL, self.depth)
        self.field_head = (
            nn.Conv2d(channels[self.field_level], 2, 3, padding=1) if config.displacement else None
        )

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
        zero = ("copy.", "refine.2.weight", "field_head.")
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
        skips = [self.encode[0](self.enter(x))]  # (B, w, S / fold, S / fold)
        for level in range(self.depth):
            skips.append(self.encode[level + 1](self.shrink[level](skips[-1])))
        decoded = self.bottom(skips[-1])
        field: Tensor | None = None
        if self.field_level == self.depth:
            field = self._predict_field(decoded)
        for level in range(self.depth - 1, -1, -1):
            skip = skips[level] if field is None else self._undo(skips[level], field, side)
            below = functional.interpolate(self.widen[level](decoded), scale_factor=2.0, mode="nearest")
            decoded = self.decode[level](below + skip)
            if level == self.field_level:
                field = self._predict_field(decoded)
        seen = x if field is None else self._undo(x, field, side)
        fine = self.unfold(decoded)  # (B, FINE_CHANNELS, S, S)
        correction = self.refine(torch.cat([fine, seen.to(fine.dtype)], dim=1))
        logits = correction.float() + self.copy(seen).float()
        return GeneratorOutput(torch.tanh(0.5 * logits), logits, field)

    def _predict_field(self, features: Tensor) -> Tensor | None:
        if self.field_head is None:
            return None
        return self.max_displacement_px * torch.tanh(self.field_head(features).float())

    @staticmethod
    def _undo(features: Tensor, field: Tensor, input_size: int) -> Tensor:
        return warp_features(features, resize_field(field, features.shape[-1], input_size))


def warp_features(features: Tensor, field: Tensor) -> Tensor:
    """Pull features through a displacement field, bilinearly; what comes from beyond the border repeats it.

    The field's component 0 points to the right, 1 upwards, and ``out(q) = in(q + d(q))``: a constant d of +3 in
    component 0 moves the image 3 pixels to the left, and +3 in component 1 moves it down (as in
    :mod:`slamgym.parametric.warp`, but in pixels).

    Args:
        features: (B, C, H, W).
        field: (B, 2, H, W) [px of ``features``].

    Returns:
        (B, C, H, W) of the features' type.
    """
    rows, cols = features.shape[-2:]
    field = field.float()
    step_x = torch.linspace(-1.0 + 1.0 / cols, 1.0 - 1.0 / cols, cols, device=field.device)
    step_y = torch.linspace(-1.0 + 1.0 / rows, 1.0 - 1.0 / rows, rows, device=field.device)
    # grid_sample's axes: x to the right, y downwards, -1 and 1 on the outer borders of the image.
    grid = torch.stack(
        [step_x + field[:, 0] * (2.0 / cols), step_y[:, None] - field[:, 1] * (2.0 / rows)], dim=-1
    )
    return functional.grid_sample(
        features, grid.to(features.dtype), mode="bilinear", padding_mode="border", align_corners=False
    )


def resize_field(field: Tensor, side: int, input_size: int) -> Tensor:
    """Give a field in input pixels the size and the pixels of a feature level.

    Args:
        field: (B, 2, h, w) [px of the input].
        side: Side of the level [px].
        input_size: Side of the input [px].

    Returns:
        (B, 2, side, side) [px of the level].
    """
    scaled = field.float() * (side / input_size)
    if field.shape[-1] == side:
        return scaled
    return functional.interpolate(scaled, size=(side, side), mode="bilinear", align_corners=False)
