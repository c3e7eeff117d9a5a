"""The growing discriminators (anime2clothing, after Karras et al. 2018).

The domain discriminator asks whether an output belongs to its input, globally and on several scales; the
real/fake discriminator asks whether the patches of an image look like a target's, in several patch sizes.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional

from slamgym.gan.networks.generators import LEAK, blend, halve

SCORE_SIDE = 4
"""Side of the features that become one score [px]."""


class SpectralConv2d(nn.Conv2d):
    """A convolution without bias whose weight matrix is divided by its largest singular value.

    Miyato et al., *Spectral Normalization for Generative Adversarial Networks* (2018): one power iteration per
    forward pass in training. The vector ``u`` is a buffer and part of the state, so that a resumed training goes
    on exactly.
    """

    u: Tensor  # (out channels,)

    def __init__(self, inputs: int, outputs: int, kernel: int, padding: int = 0) -> None:
        super().__init__(inputs, outputs, kernel, padding=padding, bias=False)
        direction = torch.randn(outputs)
        self.register_buffer("u", functional.normalize(direction, dim=0))

    def normalised_weight(self) -> Tensor:
        """The weight with spectral norm 1, by the present estimate; updates the estimate in training."""
        with torch.autocast(self.weight.device.type, enabled=False):
            matrix = self.weight.flatten(1)  # (out, in * k * k)
            with torch.no_grad():
                right = matrix.T @ self.u
                v = functional.normalize(right, dim=0)
                left = matrix @ v
                u = functional.normalize(left, dim=0)
                if self.training:
                    self.u.copy_(u)
            sigma = torch.dot(u, matrix @ v)
            return self.weight / sigma

    def forward(self, input: Tensor) -> Tensor:
        """Convolve (B, in, H, W) to (B, out, H', W')."""
        return functional.conv2d(input, self.normalised_weight(), None, self.stride, self.padding)


def minibatch_stddev(features: Tensor) -> Tensor:
    """Append a channel with the mean standard deviation over the batch, so that a lack of variety shows.

    Karras et al., *Progressive Growing of GANs* (2018), section 3.

    Args:
        features: (B, C, H, W).

    Returns:
        (B, C + 1, H, W).
    """
    wide = features.float()
    # The small number keeps the gradient of the root finite where all samples agree (a batch of one).
    variance = wide.var(dim=0, unbiased=False) + 1e-8
    deviation = variance.sqrt().mean().to(features.dtype)
    samples, _, rows, cols = features.shape
    channel = deviation.expand(samples, 1, rows, cols)
    return torch.cat([features, channel], dim=1)


class DiscriminatorBody(nn.Module):
    """One copy: an entrance and a block per resolution, then the score; fully convolutional.

    A body of depth ``d`` (a power of two, 4 or more) halves ``log2(d / 4)`` times. On an image of side ``d`` it gives
    one score, on larger ones a map of them. With ``width`` 128 the channels at a depth of 256, 128, 64 and 32 or
    less are 16, 32, 64 and 128.
    """

    def __init__(self, in_channels: int, max_depth: int, width: int = 128) -> None:
        super().__init__()
        self.max_depth = max_depth
        levels = (max_depth // SCORE_SIDE).bit_length()  # depths 4, 8, ... max_depth
        channels = [channels_at(SCORE_SIDE << level, width) for level in range(levels)]
        self.entrances = nn.ModuleList(SpectralConv2d(in_channels, count, 1) for count in channels)
        self.blocks = nn.ModuleList(
            _halving_block(channels[level], channels[level - 1]) for level in range(1, levels)
        )
        deepest = channels[0]
        self.gather = SpectralConv2d(deepest + 1, deepest, 3, padding=1)
        self.condense = SpectralConv2d(deepest, deepest, SCORE_SIDE)
        self.score = nn.Conv2d(deepest, 1, 1, bias=False)

    def forward(self, images: Tensor, depth: int, fade: float = 1.0) -> list[Tensor]:
        """Score images.

        Args:
            images: (B, in, S, S), S at least ``depth``.
            depth: Where to enter: a power of two from 4 to ``max_depth``.
            fade: Share of the entrance of this depth while it fades in; the rest enters one level further in.

        Returns:
            The features from the entrance on, (B, C, S', S') each, and last the scores
            (B, 1, 4 S / depth - 3, 4 S / depth - 3).
        """
        level = (depth // SCORE_SIDE).bit_length() - 1
        features = [self._enter(images, level)]
        for inner in range(level - 1, -1, -1):
            passed = self.blocks[inner](features[-1])
            if inner == level - 1 and fade < 1.0:
                late = self._enter(halve(images), inner)
                passed = blend(passed, late, fade)
            features.append(passed)
        gathered = self.gather(minibatch_stddev(features[-1]))
        features.append(functional.leaky_relu(gathered, LEAK))
        condensed = self.condense(features[-1])
        features.append(functional.leaky_relu(condensed, LEAK))
        features.append(self.score(features[-1]))
        return features

    def _enter(self, images: Tensor, level: int) -> Tensor:
        entered = self.entrances[level](images)
        return functional.leaky_relu(entered, LEAK)


def _halving_block(inputs: int, outputs: int) -> nn.Sequential:
    """Two convolutions and a mean of 2 x 2 pixels: (B, in, H, W) to (B, out, H / 2, W / 2)."""
    return nn.Sequential(
        SpectralConv2d(inputs, outputs, 3, padding=1),
        nn.LeakyReLU(LEAK),
        SpectralConv2d(outputs, outputs, 3, padding=1),
        nn.LeakyReLU(LEAK),
        nn.AvgPool2d(2),
    )


def channels_at(depth: int, width: int) -> int:
    """Channels of the level of this depth: ``min(16 * 256 / depth, 128)``, scaled by ``width / 128``."""
    scaled = 16 * 256 * width // (128 * depth)
    return max(1, min(scaled, width))


def copy_depths(resolution: int, fade: float = 1.0) -> list[int]:
    """Depths of the copies that take part at this resolution: 1, 1/4 and 1/16 of it.

    A copy joins where its depth is 4 or more; while a resolution fades in, those of the resolution before take part
    (so the third joins at 64 px, once that has faded in).
    """
    settled = resolution if fade >= 1.0 else resolution // 2
    return [resolution // share for share in (1, 4, 16) if settled // share >= SCORE_SIDE]


class DomainDiscriminator(nn.Module):
    """Three copies that see the pair in full, at a quarter and at a sixteenth of the resolution.

    Each gives one score to the whole pair (anime2clothing's ``PG_MultiScale``): 4,112,928 weights for two RGB
    images at 256 px.
    """

    def __init__(
        self, in_channels: int, out_channels: int, resolution: int = 256, width: int = 128
    ) -> None:
        super().__init__()
        self.copies = nn.ModuleList(
            DiscriminatorBody(in_channels + out_channels, depth, width)
            for depth in copy_depths(resolution)
        )

    def forward(self, x: Tensor, y: Tensor, fade: float = 1.0) -> list[list[Tensor]]:
        """Score pairs.

        Args:
            x: Inputs at the output's size, (B, in, R, R).
            y: Outputs or targets, (B, out, R, R).
            fade: As in :meth:`DiscriminatorBody.forward`.

        Returns:
            For each copy its features, the last one the scores (B, 1, 1, 1).
        """
        pair = torch.cat([x, y], dim=1)
        resolution = y.shape[-1]
        depths = copy_depths(resolution, fade)
        features = []
        for copy, depth in zip(self.copies, depths, strict=False):
            coarse = functional.avg_pool2d(pair, resolution // depth)
            features.append(copy(coarse, depth, fade))
        return features


class RealFakeDiscriminator(nn.Module):
    """Three copies of different depth, all on the full image: 1 x 1, 13 x 13 and 61 x 61 scores at 256 px.

    anime2clothing's ``PG_MultiPatch``: 4,108,176 weights for RGB at 256 px. The second and third copy run at full
    resolution with the channels of a deeper level, so nearly all of the cost is theirs; ``patch_width`` narrows them.
    """

    def __init__(
        self, channels: int, resolution: int = 256, width: int = 128, patch_width: int = 128
    ) -> None:
        super().__init__()
        self.copies = nn.ModuleList(
            DiscriminatorBody(channels, depth, patch_width if number else width)
            for number, depth in enumerate(copy_depths(resolution))
        )

    def forward(self, y: Tensor, fade: float = 1.0) -> list[list[Tensor]]:
        """Score images.

        Args:
            y: Outputs or targets, (B, C, R, R).
            fade: As in :meth:`DiscriminatorBody.forward`.

        Returns:
            For each copy its features, the last one the scores (B, 1, P, P).
        """
        depths = copy_depths(y.shape[-1], fade)
        features = []
        for copy, depth in zip(self.copies, depths, strict=False):
            features.append(copy(y, depth, fade))
        return features
