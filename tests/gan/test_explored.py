"""Where a SLAM map is evidence of floor, and that targets and translations end there."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgym.core.errors import ConfigError
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN
from slamgym.gan.config import AugmentConfig, GeneratorConfig, TranslatorConfig
from slamgym.gan.data import PairSet
from slamgym.gan.device import choose_compute
from slamgym.gan.networks.factory import build_generator
from slamgym.gan.presets import find_preset
from slamgym.gan.training.sampler import BatchSampler
from slamgym.gan.translation.finishing import explored_floor, limited_to_explored
from slamgym.gan.translation.translate import LearnedTranslator
from slamgym.gan.weights import ModelCard

SCALE = 0.1


def half_explored():
    """A hall of 8 m by 4 m whose left half was seen, but for a bed of 1.5 m in it."""
    cad = np.zeros((60, 100), np.uint8)
    cad[10:50, 10:90] = FREE
    slam = np.full(cad.shape, UNKNOWN, np.uint8)
    slam[10:50, 10:50] = FREE
    slam[25:40, 20:35] = UNKNOWN
    return cad, slam


def test_gaps_are_closed_and_frontiers_are_passed_by_the_margin_alone():
    cad, slam = half_explored()
    target = limited_to_explored(cad, slam, SCALE, margin=0.5)
    assert (target[10:50, 10:50] == FREE).all()  # with the bed
    assert (target[10:50, 50:54] == FREE).all()
    assert not target[:, 56:].any()
    assert not target[:10].any()  # no floor that the CAD map hasn't


def test_sizes_are_in_metres_and_an_unknown_scale_is_taken_as_usual():
    _, slam = half_explored()
    large = slam.repeat(2, axis=0).repeat(2, axis=1)
    fine = explored_floor(large, SCALE / 2, 0.5)[::2, ::2]
    assert np.mean(fine == explored_floor(slam, SCALE, 0.5)) > 0.99
    assert explored_floor(slam, float("nan"), 0.5).any()


@given(seed=st.integers(0, 1000), margin=st.floats(0.0, 1.0))
@settings(max_examples=20, deadline=None)
def test_what_was_seen_is_explored_and_a_longer_margin_explores_more(seed, margin):
    rng = np.random.default_rng(seed)
    slam = np.full((40, 40), UNKNOWN, np.uint8)
    row, col = rng.integers(0, 25, 2)
    slam[row : row + 14, col : col + 12] = FREE
    slam[row : row + 14, col + 12 : col + 13] = OCCUPIED
    near, far = explored_floor(slam, SCALE, margin), explored_floor(slam, SCALE, margin + 0.3)
    assert near[slam == FREE].all()
    assert far[near].all()
    assert far.sum() > near.sum() or near.all()


@pytest.mark.parametrize("value", [UNKNOWN, OCCUPIED])
def test_without_free_space_or_with_single_cells_nothing_is_explored(value):
    slam = np.full((30, 40), value, np.uint8)
    assert not explored_floor(slam, SCALE, 0.5).any()
    slam[5, 7] = FREE
    assert not explored_floor(slam, SCALE, 0.5).any()
    assert explored_floor(np.full((30, 40), FREE, np.uint8), SCALE, 0.5).all()


def training(margin):
    config = find_preset("slam2cad")
    translator = dataclasses.replace(config.translator, explored_margin=margin)
    return dataclasses.replace(config, translator=translator, augment=AugmentConfig())


def test_training_targets_end_where_the_map_does(monkeypatch):
    monkeypatch.setattr("slamgym.gan.training.sampler.flipped", lambda image, symmetry: image)
    cad, slam = (np.stack([image[:60, :60]]) for image in half_explored())
    slam[0, 30:] = UNKNOWN
    pairs = PairSet(cad, slam, ("a",), ("a",), np.array([SCALE]))
    whole, limited = (
        BatchSampler(pairs, training(margin), np.random.default_rng(0)).draw(1) for margin in (0.0, 0.5)
    )
    assert np.array_equal(whole.cad, cad)
    assert np.array_equal(limited.cad[0], limited_to_explored(cad[0], slam[0], SCALE, 0.5))
    assert (limited.cad != whole.cad).any()
    assert limited.other_cad is None


@pytest.mark.parametrize("margin", [0.0, 0.5])
def test_a_translation_ends_where_the_map_does(margin):
    config = TranslatorConfig(
        input_size=64, output_size=64, input_encoding="free_occupied", output_encoding="grey", explored_margin=margin,
        generator=GeneratorConfig("residual", width=8, depth=2),
    )  # fmt: skip
    generator = build_generator(config)
    generator.copy.weight.data.zero_()
    generator.refine[-1].bias.data.fill_(3.0)  # floor everywhere
    translator = LearnedTranslator(generator.eval(), config, ModelCard(), choose_compute("cpu", "float32"))
    slam = half_explored()[1]
    free = translator.translate(slam, SCALE) >= 0.5
    expected = np.ones_like(free) if margin == 0.0 else explored_floor(slam, SCALE, margin)
    known = np.zeros_like(free)
    known[8:52, 8:52] = True  # beyond the content's margin nothing is drawn
    assert np.array_equal(free[known], expected[known])
    assert margin == 0.0 or not free[:, 60:].any()


def test_an_impossible_margin_is_refused():
    with pytest.raises(ConfigError, match="explored_margin"):
        TranslatorConfig(explored_margin=-1.0)
