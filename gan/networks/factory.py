"""Build the networks that the settings describe, and run a generator on maps."""

import functools
from collections.abc import Callable

import numpy as np
import torch
from torch import nn
from torch.nn import functional

from slamgym.core.types import ByteArray, Float32Array
from slamgym.gan.config import CHANNELS, TRANSLATION_BATCH, DiscriminatorConfig, TranslatorConfig
from slamgym.gan.device import Compute
from slamgym.gan.encoding import encode
from slamgym.gan.networks.discriminators import (
    DomainDiscriminator,
    RealFakeDiscriminator,
    SpectralConv2d,
)
from slamgym.gan.networks.generators import ProgressiveGenerator, ResidualUNet

Generator = ProgressiveGenerator | ResidualUNet

INITIAL_STD = 0.02
"""Convolutions start as N(0, 0.02), batch norms with gains N(1, 0.02) (anime2clothing)."""


def build_generator(config: TranslatorConfig, seed: int | None = 0) -> Generator:
    """The generator with freshly drawn weights.

    Args:
        config: What it is.
        seed: Equal seeds give equal weights; None lets torch draw them, for a network that will be loaded.
    """
    inputs = CHANNELS[config.input_encoding]
    outputs = CHANNELS[config.output_encoding]
    if config.generator.kind == "residual":
        unet = ResidualUNet(inputs, outputs, config.generator)
        if seed is not None:
            unet.start(torch.Generator().manual_seed(seed))
        return unet
    width = config.generator.width
    progressive = ProgressiveGenerator(inputs, outputs, config.input_size, width)
    if seed is not None:
        initialise(progressive, torch.Generator().manual_seed(seed))
    return progressive


def build_discriminators(
    config: TranslatorConfig, parts: DiscriminatorConfig, seed: int = 0
) -> nn.ModuleDict:
    """The discriminators (``domain``, ``real_fake``), with freshly drawn weights, on the CPU."""
    inputs = CHANNELS[config.input_encoding]
    outputs = CHANNELS[config.output_encoding]
    side = config.output_size
    domain = DomainDiscriminator(inputs, outputs, side, parts.width)
    real_fake = RealFakeDiscriminator(outputs, side, parts.width, parts.patch_width)
    networks = nn.ModuleDict({"domain": domain, "real_fake": real_fake})
    initialise(networks, torch.Generator().manual_seed(seed + 1))
    return networks


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
            direction = torch.randn(module.u.shape, generator=generator)
            module.u.copy_(functional.normalize(direction, dim=0))


def count_parameters(network: nn.Module) -> int:
    """Number of trained values."""
    return sum(parameter.numel() for parameter in network.parameters())


def on_device(
    generator: Generator, config: TranslatorConfig, compute: Compute
) -> Callable[[ByteArray], Float32Array]:
    """Put a generator in evaluation mode on a device; returns what translates maps there (:func:`run_generator`)."""
    return functools.partial(
        run_generator,
        compute.put(generator),
        config=config,
        compute=compute,
        resolution=config.output_size,
    )


def run_generator(
    generator: Generator,
    inputs: ByteArray,
    config: TranslatorConfig,
    compute: Compute,
    resolution: int,
) -> Float32Array:
    """Translate a stack of maps in evaluation mode.

    Args:
        generator: It stays in evaluation mode.
        inputs: (N, S, S) uint8 cells.
        config: How to encode.
        compute: Device and precision.
        resolution: Side of the output.

    Returns:
        (N, out, R, R) in [-1, 1].
    """
    generator.eval()
    images = []
    with torch.inference_mode(), compute.autocast():
        for first in range(0, len(inputs), TRANSLATION_BATCH):
            some = inputs[first : first + TRANSLATION_BATCH]
            cells = torch.from_numpy(some).to(compute.device)
            x = encode(cells, config.input_encoding)
            x = x.contiguous(memory_format=compute.memory_format)
            image = generator(x, resolution).image
            images.append(image.float().cpu().numpy())
    return np.concatenate(images)
