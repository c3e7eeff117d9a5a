"""Build the networks that the settings describe."""

import torch
from torch import nn

from slamgym.gan.config import CHANNELS, DiscriminatorConfig, LossConfig, TranslatorConfig
from slamgym.gan.networks.discriminators import DomainDiscriminator, RealFakeDiscriminator
from slamgym.gan.networks.generator import ProgressiveGenerator
from slamgym.gan.networks.layers import initialise
from slamgym.gan.networks.residual_unet import ResidualUNet

Generator = ProgressiveGenerator | ResidualUNet


def build_generator(config: TranslatorConfig, seed: int | None = 0) -> Generator:
    """The generator with freshly drawn weights.

    Args:
        config: What it is.
        seed: Equal seeds give equal weights; None leaves them to torch, for a network that will be loaded.
    """
    inputs, outputs = CHANNELS[config.input_encoding], CHANNELS[config.output_encoding]
    parts = config.generator
    if parts.kind == "residual":
        unet = ResidualUNet(
            inputs,
            outputs,
            parts.width,
            parts.depth,
            parts.displacement,
            parts.max_displacement_px,
            parts.fold,
        )
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
    """The judges that the losses need (``domain``, ``real_fake``), with freshly drawn weights, on the CPU."""
    inputs, outputs = CHANNELS[config.input_encoding], CHANNELS[config.output_encoding]
    judges = nn.ModuleDict()
    if parts.domain and max(loss.domain, loss.feature_matching) > 0.0:
        judges["domain"] = DomainDiscriminator(inputs, outputs, config.output_size, parts.width)
    consistency = loss.input_consistency if loss.input_consistency_reference != "none" else 0.0
    if parts.real_fake and max(loss.real_fake, consistency) > 0.0:
        judges["real_fake"] = RealFakeDiscriminator(
            outputs, config.output_size, parts.width, parts.patch_width
        )
    initialise(judges, torch.Generator().manual_seed(seed + 1))
    return judges
