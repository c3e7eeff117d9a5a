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
"""

import torch
from torch import Tensor, nn

from slamgym.gan.networks.layers import DoubleConv, GeneratorOutput, blend, double, halve

INNERMOST_SIDE = 2
"""Side of the innermost feature [px]."""


class ProgressiveGenerator(nn.Module):
    """Gives images of any of its resolutions for an input of one size."""

    def __init__(self, in_channels: int, out_channels: int, input_size: int = 256, width: int = 32) -> None:
        super().__init__()
        self.input_size = input_size
        self.halvings = (input_size // INNERMOST_SIDE).bit_length() - 1  # 7 for 256 px
        fine, middle, coarse = width, 2 * width, 4 * width
        # Encoder level i has side input_size / 2**i; the levels from the fourth halving on are wide.
        encoder = [fine] + [middle if level <= 3 else coarse for level in range(1, self.halvings + 1)]
        self.enter = DoubleConv(in_channels, fine)
        self.down = nn.ModuleList(DoubleConv(encoder[i], encoder[i + 1]) for i in range(self.halvings))
        sides = [INNERMOST_SIDE << step for step in range(1, self.halvings + 1)]
        decoder = [coarse, *(self._decoder_channels(side, fine, middle, coarse) for side in sides)]
        self.grow = nn.ModuleList()
        for step in range(self.halvings):
            skip = encoder[self.halvings - step] if step > 0 else 0
            self.grow.append(DoubleConv(skip + decoder[step], decoder[step + 1]))
        self.heads = nn.ModuleList(
            nn.Conv2d(channels, out_channels, 1, bias=False) for channels in decoder[1:]
        )

    def _decoder_channels(self, side: int, fine: int, middle: int, coarse: int) -> int:
        if side == self.input_size:
            return fine
        return coarse if side < self.input_size // 8 else middle

    def forward(self, x: Tensor, resolution: int | None = None, fade: float = 1.0) -> GeneratorOutput:
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
        decoded = coarser = self.grow[0](double(features[-1]))  # (B, 128, 4, 4)
        for step in range(1, last + 1):
            joined = torch.cat([features[self.halvings - step], decoded], dim=1)
            coarser, decoded = decoded, self.grow[step](double(joined))
        scores: Tensor = self.heads[last](decoded).float()  # (B, out, resolution, resolution)
        if fade >= 1.0 or last == 0:
            return GeneratorOutput(torch.tanh(scores), logits=2.0 * scores)
        old = torch.tanh(self.heads[last - 1](coarser).float())
        return GeneratorOutput(blend(torch.tanh(scores), double(old), fade))

    def _step_of(self, resolution: int) -> int:
        step = (resolution // INNERMOST_SIDE).bit_length() - 2
        if resolution != INNERMOST_SIDE << (step + 1) or not 0 <= step < self.halvings:
            raise ValueError(f"resolution {resolution} isn't a power of two from 4 to {self.input_size}")
        return step
