"""Build the networks that the settings describe, and run a generator on maps."""

import numpy as np
import torch
from torch import nn

from slamgym.core.types import ByteArray, Float32Array
from slamgym.gan.config import CHANNELS, DiscriminatorConfig, LossConfig, TranslatorConfig
from slamgym.gan.device import Compute
from slamgym.gan.encoding import encode
from slamgym.gan.networks.discriminators import DomainDiscriminator, RealFakeDiscriminator
from slamgym.gan.networks.generator import ProgressiveGenerator
from slamgym.gan.networks.layers import initialise
from slamgym.gan.networks.residual_unet import ResidualUNet

Generator = ProgressiveGenerator | ResidualUNet

TRANSLATION_BATCH = 8
"""Maps that go through a generator at once."""


def build_generator(config: TranslatorConfig, seed: int | None = 0) -> Generator:
    """The generator with freshly drawn weights.

    Args:
        config: What it is.
        seed: Equal seeds give equal weights; None leaves them to torch, for a network that will be loaded.
    """
    inputs, outputs = CHANNELS[config.input_encoding], CHANNELS[config.output_encoding]
    parts = config.generator
    if parts.kind == "residual":
        unet = ResidualUNet(inputs, outputs, parts)
        if seed is not None:
            unet.start(torch.Generator().manual_seed(seed))
        return unet
    progressive = ProgressiveGenerator(inputs, outputs, config.input_size, parts.width)
    if seed is not None:
        initialise(progressive, torch.Generator().manual_seed(seed))
    return progressive


def build_discriminators(
    config: TranslatorConfig, parts: DiscriminatorConfig, loss: LossConfig, seed: int = 0
) -> nn.ModuleDict:
    """The discriminators that the losses need (``domain``, ``real_fake``), with freshly drawn weights, on the CPU."""
    inputs, outputs = CHANNELS[config.input_encoding], CHANNELS[config.output_encoding]
    networks = nn.ModuleDict()
    if parts.domain and max(loss.domain, loss.feature_matching) > 0.0:
        networks["domain"] = DomainDiscriminator(inputs, outputs, config.output_size, parts.width)
    if parts.real_fake and max(loss.real_fake, loss.input_consistency) > 0.0:
        networks["real_fake"] = RealFakeDiscriminator(
            outputs, config.output_size, parts.width, parts.patch_width
        )
    initialise(networks, torch.Generator().manual_seed(seed + 1))
    return networks


def run_generator(
    generator: Generator, inputs: ByteArray, config: TranslatorConfig, compute: Compute, resolution: int
) -> Float32Array:
    """Translate a stack of maps in evaluation mode.

    Args:
        generator: Left in evaluation mode.
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
            cells = torch.from_numpy(inputs[first : first + TRANSLATION_BATCH]).to(compute.device)
            x = encode(cells, config.input_encoding).contiguous(memory_format=compute.memory_format)
            images.append(generator(x, resolution).image.float().cpu().numpy())
    return np.concatenate(images)
