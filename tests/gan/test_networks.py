"""Shapes and sizes of the networks; the counts are those of the published code (RGB, 256 px)."""

import pytest
import torch
from torch import nn

from slamgym.core.errors import ConfigError
from slamgym.gan.config import GeneratorConfig, TranslatorConfig
from slamgym.gan.networks.discriminators import (
    DiscriminatorBody,
    DomainDiscriminator,
    RealFakeDiscriminator,
    SpectralConv2d,
    channels_at,
    copy_depths,
    minibatch_stddev,
)
from slamgym.gan.networks.factory import count_parameters, initialise
from slamgym.gan.networks.generators import ProgressiveGenerator, ResidualUNet, blend


def test_counts_are_those_of_the_published_code():
    generator = ProgressiveGenerator(3, 3, 256)
    domain, real_fake = DomainDiscriminator(3, 3, 256), RealFakeDiscriminator(3, 256)
    assert count_parameters(generator) == 2_957_184
    assert count_parameters(domain) == 4_112_928
    assert count_parameters(real_fake) == 4_108_176


@pytest.mark.parametrize(
    ("resolution", "trained"), [(32, 2.69), (64, 2.80), (128, 2.91), (256, 2.96)]
)
def test_only_the_decoder_up_to_the_resolution_is_trained(resolution, trained):
    generator = ProgressiveGenerator(3, 3, 256).eval()
    # The parameters that a forward pass uses are those that get a gradient.
    used = set()
    for module in generator.modules():
        if not list(module.children()):
            module.register_forward_hook(lambda m, *_: used.update(id(p) for p in m.parameters()))
    with torch.inference_mode():
        generator(torch.zeros(1, 3, 256, 256), resolution)
    millions = sum(p.numel() for p in generator.parameters() if id(p) in used) / 1e6
    assert millions == pytest.approx(trained, abs=0.005)


def test_scores_at_256_px_have_the_published_shapes():
    domain, real_fake = DomainDiscriminator(1, 1, 256, 8), RealFakeDiscriminator(1, 256, 8, 8)
    x, y = torch.zeros(2, 1, 256, 256), torch.zeros(2, 1, 256, 256)
    with torch.inference_mode():
        assert [f[-1].shape[-1] for f in domain(x, y)] == [1, 1, 1]
        assert [f[-1].shape[-1] for f in real_fake(y)] == [1, 13, 61]


def test_at_32_px_two_copies_take_part_and_the_third_joins_once_64_has_faded_in():
    assert copy_depths(32) == [32, 8]
    assert copy_depths(64, fade=0.5) == [64, 16]
    assert copy_depths(64) == [64, 16, 4]
    assert copy_depths(128, fade=0.5) == [128, 32, 8]


def test_channels_follow_the_published_rule():
    assert [channels_at(side, 128) for side in (256, 128, 64, 32, 16, 4)] == [
        16,
        32,
        64,
        128,
        128,
        128,
    ]
    assert channels_at(256, 32) == 4


@pytest.mark.parametrize("channels", [1, 2, 3])
@pytest.mark.parametrize("resolution", [4, 8, 16, 32])
def test_the_generator_draws_every_resolution_from_any_number_of_channels(channels, resolution):
    generator = ProgressiveGenerator(channels, 2, 32, width=2)
    drawing = generator(torch.randn(2, channels, 32, 32), resolution)
    assert drawing.image.shape == (2, 2, resolution, resolution)
    assert drawing.image.abs().max() <= 1.0
    assert drawing.logits is None


@pytest.mark.parametrize("resolution", [2, 12, 64])
def test_the_generator_refuses_other_resolutions(resolution):
    with pytest.raises(ValueError, match="power of two from 4 to 32"):
        ProgressiveGenerator(1, 1, 32, width=2)(torch.zeros(1, 1, 32, 32), resolution)


@pytest.mark.parametrize("channels", [1, 2, 3])
def test_the_residual_network_draws_at_its_inputs_size(channels):
    drawing = ResidualUNet(channels, 4, GeneratorConfig("residual", 8, 3))(
        torch.randn(2, channels, 32, 32)
    )
    assert drawing.image.shape == (2, 4, 32, 32)
    shares = 0.5 * (drawing.image + 1.0)
    assert torch.allclose(shares.sum(dim=1), torch.ones(2, 32, 32))


def test_the_residual_network_starts_by_copying_its_input():
    network = ResidualUNet(2, 4, GeneratorConfig("residual", 8, 3))
    network.start(torch.Generator().manual_seed(0))
    free = torch.randn(2, 1, 32, 32).sign()
    with torch.no_grad():
        floor, wall = network(torch.cat([free, -free], dim=1)).image[:, :2].split(1, dim=1)
    assert torch.equal((floor - wall).sign(), free)


def test_a_depth_that_does_not_fit_is_refused():
    with pytest.raises(ConfigError, match="depth"):
        TranslatorConfig(
            input_size=64,
            output_size=64,
            output_encoding="layers",
            generator=GeneratorConfig("residual", depth=5),
        )


def fading_generator():
    torch.manual_seed(1)
    return ProgressiveGenerator(1, 1, 32, width=2).eval(), torch.randn(2, 1, 32, 32)


def test_the_fade_in_begins_with_the_coarse_drawing_and_ends_with_the_fine_one():
    generator, x = fading_generator()
    with torch.no_grad():
        coarse, fine = generator(x, 16).image, generator(x, 32).image
        first, last = generator(x, 32, fade=1e-7).image, generator(x, 32, fade=1.0 - 1e-7).image
    assert torch.allclose(first, coarse.repeat_interleave(2, 2).repeat_interleave(2, 3), atol=1e-5)
    assert torch.allclose(last, fine, atol=1e-5)


def test_the_fade_in_is_linear_in_the_images():
    generator, x = fading_generator()
    with torch.no_grad():
        quarter, half, three = (generator(x, 32, fade=f).image for f in (0.25, 0.5, 0.75))
    assert torch.allclose(half, 0.5 * (quarter + three), atol=1e-6)


def test_a_discriminator_fades_in_from_that_of_half_the_size():
    torch.manual_seed(0)
    body = DiscriminatorBody(1, 16, width=8).eval()
    images = torch.randn(2, 1, 16, 16)
    coarse = nn.functional.avg_pool2d(images, 2)
    with torch.no_grad():
        before, early = body(coarse, 8), body(images, 16, fade=1e-6)
        late, after = body(images, 16, fade=1.0 - 1e-6), body(images, 16)
    assert torch.allclose(before[-1], early[-1], atol=1e-4)
    assert torch.allclose(late[-1], after[-1], atol=1e-4)


def test_spectral_convolution_has_norm_one_and_power_iteration_stops_in_evaluation():
    torch.manual_seed(0)
    layer = SpectralConv2d(6, 5, 3)
    for _ in range(100):
        layer(torch.zeros(1, 6, 4, 4))
    largest = torch.linalg.matrix_norm(layer.normalised_weight().detach().flatten(1), ord=2)
    assert float(largest) == pytest.approx(1.0, abs=1e-4)
    layer.eval()
    before = layer.u.clone()
    layer(torch.zeros(1, 6, 4, 4))
    assert torch.equal(layer.u, before)


def test_minibatch_stddev_is_the_mean_deviation_over_the_batch():
    features = torch.zeros(2, 2, 1, 1)
    features[1, 0], features[1, 1] = 2.0, 4.0  # deviations 1 and 2
    widened = minibatch_stddev(features)
    assert widened.shape == (2, 3, 1, 1)
    assert widened[:, 2].flatten().tolist() == pytest.approx([1.5, 1.5])


def test_minibatch_stddev_of_one_sample_has_a_finite_gradient():
    features = torch.randn(1, 2, 2, 2, requires_grad=True)
    minibatch_stddev(features).sum().backward()
    assert torch.isfinite(features.grad).all()


def test_blend_at_its_ends():
    new, old = torch.ones(1), torch.zeros(1)
    assert blend(new, old, 1.0) is new
    assert float(blend(new, old, 0.25)) == 0.25


def test_initial_weights_have_the_published_spread_and_follow_the_seed():
    first, same, other = (ProgressiveGenerator(1, 1, 32, 8) for _ in range(3))
    for network, seed in ((first, 5), (same, 5), (other, 6)):
        initialise(network, torch.Generator().manual_seed(seed))
    weight = first.down[1][0].weight.detach()
    assert float(weight.std()) == pytest.approx(0.02, rel=0.1)
    assert torch.equal(weight, same.down[1][0].weight)
    assert not torch.equal(weight, other.down[1][0].weight)
