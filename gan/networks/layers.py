"""Layers that the networks share."""

from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional


class GeneratorOutput(NamedTuple):
    """The output of a generator."""

    image: Tensor  # (B, out, R, R) in [-1, 1]
    logits: Tensor | None = None
    """Log odds of each value being 1 instead of -1, so that ``image = tanh(logits / 2)``; same shape. None while
    two resolutions are blended."""


LEAK = 0.2
"""Slope of the leaky rectifiers (anime2clothing)."""
INITIAL_STD = 0.02
"""Convolutions start as N(0, 0.02), batch norms with gains N(1, 0.02) (anime2clothing)."""


class SpectralConv2d(nn.Conv2d):
    """A convolution without bias whose weight matrix is divided by its largest singular value.

    Miyato et al., *Spectral Normalization for Generative Adversarial Networks* (2018): one power iteration per
    forward pass in training. The vector ``u`` is a buffer and part of the state, so that a resumed training goes
    on exactly.
    """

    u: Tensor  # (out channels,)

    def __init__(self, inputs: int, outputs: int, kernel: int, padding: int = 0) -> None:
        super().__init__(inputs, outputs, kernel, padding=padding, bias=False)
        self.register_buffer("u", functional.normalize(torch.randn(outputs), dim=0))

    def normalised_weight(self) -> Tensor:
        """The weight with spectral norm 1, by the present estimate; updates the estimate in training."""
        with torch.autocast(self.weight.device.type, enabled=False):
            matrix = self.weight.flatten(1)  # (out, in * k * k)
            with torch.no_grad():
                v = functional.normalize(matrix.T @ self.u, dim=0)
                u = functional.normalize(matrix @ v, dim=0)
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
    deviation = (wide.var(dim=0, unbiased=False) + 1e-8).sqrt().mean()
    channel = deviation.to(features.dtype).expand(features.shape[0], 1, *features.shape[2:])
    return torch.cat([features, channel], dim=1)


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


def initialise(network: nn.Module, generator: torch.Generator) -> None:
    """Initialise all weights: convolutions N(0, 0.02), gains N(1, 0.02), power iteration vectors on the sphere.

    Args:
        network: Changed in place; it must be on the CPU.
        generator: Source of the draws.
    """
    for module in network.modules():
        if isinstance(module, nn.Conv2d):
            nn.init.normal_(module.weight, 0.0, INITIAL_STD, generator=generator)
            if module.bias is not None:
                nn.init.zeros_(module.bias)
        if isinstance(module, nn.BatchNorm2d):
            nn.init.normal_(module.weight, 1.0, INITIAL_STD, generator=generator)
            nn.init.zeros_(module.bias)
        if isinstance(module, SpectralConv2d):
            module.u.copy_(functional.normalize(torch.randn(module.u.shape, generator=generator), dim=0))


def halve(images: Tensor) -> Tensor:
    """Mean of 2 x 2 pixels: (B, C, H, W) to (B, C, H / 2, W / 2)."""
    return functional.avg_pool2d(images, 2)


def double(images: Tensor) -> Tensor:
    """Repeat each pixel 2 x 2: (B, C, H, W) to (B, C, 2 H, 2 W)."""
    return functional.interpolate(images, scale_factor=2.0, mode="nearest")


def shrink_to(images: Tensor, side: int) -> Tensor:
    """Area mean down to (B, C, side, side); thin walls grow pale rather than vanish."""
    factor = images.shape[-1] // side
    return functional.avg_pool2d(images, factor) if factor > 1 else images


def blend(new: Tensor, old: Tensor, fade: float) -> Tensor:
    """The mixture while a resolution fades in: ``fade`` 0 is all old, 1 all new."""
    return new if fade >= 1.0 else torch.lerp(old, new, fade)


def count_parameters(network: nn.Module) -> int:
    """Number of trained values."""
    return sum(parameter.numel() for parameter in network.parameters())
