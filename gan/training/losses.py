"""The terms that the networks minimise, one function each; equation numbers are the paper's.

A discriminator returns, for each of its copies (scales), a list of features whose last entry holds the scores (logits).
Every sample and every scale takes part in every term.

Eqs. (2) to (5) have two forms. ``lsgan``: squares, and the weights that the published code gives to the first layers.
``printed``: the paper's logarithms, summed, and every layer i with the weight 1 / N_i, its number of values.
"""

import functools
from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn import functional

from slamgym.gan.config import LossForm

Features = Sequence[Sequence[Tensor]]
"""Features per copy, the last one the scores."""
LAYER_WEIGHTS = (5.0, 1.5, 1.5, 1.5, 1.0)
"""Weights of the first layers in feature matching and input consistency (published code; in neither paper)."""
EDGE_WEIGHT = 3.0
"""Pixels within two of a border count 1 + this in the cross entropy."""
WALL_WEIGHT = 6.0
"""Pixels in and next to thin walls count as much more: one hole in such a wall joins two rooms."""


def adversarial_loss(scores: Tensor, real: bool, form: LossForm = "lsgan") -> Tensor:
    """Distance of scores from ``real`` (1) or fake (0).

    The mean of squares (LSGAN, Mao et al. 2017), or of the logarithms of eqs. (2) and (3): -log D, or -log(1 - D), of
    D = sigmoid(scores).

    Args:
        scores: Any shape, before any sigmoid.
        real: Their target.
        form: ``lsgan`` or ``printed``.
    """
    target = torch.full_like(scores, float(real), dtype=torch.float32)
    if form == "printed":
        return functional.binary_cross_entropy_with_logits(scores.float(), target)
    return functional.mse_loss(scores.float(), target)


def _over_copies(copies: Features, real: bool, form: LossForm) -> Tensor:
    terms = [adversarial_loss(features[-1], real, form) for features in copies]
    return torch.stack(terms).sum()


def discriminator_loss(
    real: Features, fakes: Sequence[Features], form: LossForm = "lsgan"
) -> Tensor:
    """Eqs. (2) and (3) for a discriminator, which maximises what is minimised here.

    The kinds of input are averaged, as in the published code, or added, as printed; each is a sum over the copies.

    Args:
        real: Of (x, y), or of y for the real/fake discriminator.
        fakes: Of (x, G(x)) and of an unassociated target (x, y'); or of G(x).
        form: ``lsgan`` or ``printed``.
    """
    of_real = _over_copies(real, True, form)
    of_fakes = [_over_copies(fake, False, form) for fake in fakes]
    kinds = torch.stack([of_real, *of_fakes])
    return kinds.sum() if form == "printed" else kinds.mean()


def taken_for_real_loss(fake: Features, form: LossForm = "lsgan") -> Tensor:
    """Eqs. (2) and (3) for the generator: a discriminator shall take every output for real. Sum over the copies.

    With logarithms it minimises -log D(G(x)) where the print has log(1 - D(G(x))): the two have their minimum in the
    same place, but the printed one hardly has a gradient where an output is recognised (Goodfellow et al. 2014).
    """
    return _over_copies(fake, True, form)


def feature_matching_loss(fake: Features, reference: Features, form: LossForm = "lsgan") -> Tensor:
    """Eqs. (4) and (5): a discriminator's features of the output and of a reference shall agree. Sum over the copies.

    Eq. (4) compares the domain discriminator's features of (x, G(x)) and (x, y). Eq. (5), input consistency, compares
    the real/fake discriminator's of G(x) and of y (the published code: of x). As printed all layers count, the scores
    among them, each as the sum of its differences over its number of values; ``lsgan`` leaves the scores out.

    Args:
        fake: Of the output.
        reference: Taken as constants.
        form: ``lsgan`` or ``printed``.
    """
    distances = []
    for ours, theirs in zip(fake, reference, strict=True):  # one copy each
        weights: Sequence[float] = LAYER_WEIGHTS[: len(ours) - 1]
        if form == "printed":
            weights = [1.0] * len(ours)
        terms = []
        for weight, our, their in zip(weights, ours, theirs, strict=False):
            constant = their.detach().float()
            distance = functional.l1_loss(our.float(), constant)
            terms.append(weight * distance)
        distances.append(torch.stack(terms).sum())
    return torch.stack(distances).sum()


def l1_loss(image: Tensor, target: Tensor) -> Tensor:
    """The term that omega weighs, eq. (6): mean |y - G(x)| in [-1, 1]."""
    return functional.l1_loss(image.float(), target.float())


def probabilities(image: Tensor) -> Tensor:
    """Probability of each value being 1: images in [-1, 1] as values in [0, 1]."""
    return 0.5 * (image.float() + 1.0)


def cross_entropy_loss(logits: Tensor, target: Tensor) -> Tensor:
    """Weighted mean cross entropy of layers, of which each pixel may have shares.

    Args:
        logits: (B, 4, H, W).
        target: Same shape, shares in [-1, 1].
    """
    wanted = probabilities(target)
    log_shares = functional.log_softmax(logits.float(), dim=1)
    surprise = wanted * log_shares
    terms = -surprise.sum(dim=1, keepdim=True)
    floor = free_share(wanted)
    of_borders = EDGE_WEIGHT * near_borders(floor)
    of_walls = WALL_WEIGHT * near_thin_walls(floor)
    weights = 1.0 + of_borders + of_walls
    return (weights * terms).sum() / weights.sum()


def free_share(layers: Tensor) -> Tensor:
    """Floor and doors of layers in [0, 1]: (B, 4, H, W) to (B, 1, H, W)."""
    floor = layers[:, 0:1]
    doors = layers[:, 2:3]
    return floor + doors


def near_borders(values: Tensor, radius: int = 2) -> Tensor:
    """1 where the square of pixels within ``radius`` holds both kinds of values, else 0; (B, C, H, W).

    Args:
        values: (B, C, H, W) in [0, 1], mostly near the ends.
        radius: [px]
    """
    window = 2 * radius + 1
    # A mean is far cheaper than the largest and the smallest value, and differs from 0 and 1 as soon as one pixel does.
    mean = functional.avg_pool2d(values, window, stride=1, padding=radius, count_include_pad=False)
    margin = 0.5 / window**2
    is_mixed = (mean > margin) & (mean < 1.0 - margin)
    return is_mixed.float()


THICKEST_THIN_WALL = 7
"""Maximum thickness of the walls that :func:`near_thin_walls` finds [px]: 35 cm at cells of 5 cm."""


def near_thin_walls(values: Tensor, beside: int = 2) -> Tensor:
    """1 in thin walls with floor on both sides and within ``beside`` pixels of them, else 0; (B, C, H, W).

    The floor next to a wall counts as much as the wall, or the network would draw walls too thick where it isn't sure
    of their place.

    Args:
        values: (B, C, H, W) in [0, 1], floor 1.
        beside: [px]
    """
    floor = (values >= 0.5).to(values.dtype)
    window = THICKEST_THIN_WALL
    half = window // 2
    # Closing the floor along rows, or along columns, covers thin walls; corners of rooms stay.
    along_rows = _closed(floor, (1, window), (0, half))
    along_columns = _closed(floor, (window, 1), (half, 0))
    walls = torch.maximum(along_rows, along_columns) - floor
    return functional.max_pool2d(walls, 2 * beside + 1, stride=1, padding=beside)


def _closed(floor: Tensor, window: tuple[int, int], padding: tuple[int, int]) -> Tensor:
    """Morphological closing: gaps between floor that are narrower than the window become floor."""
    widest = functools.partial(functional.max_pool2d, kernel_size=window, stride=1, padding=padding)
    grown = widest(floor)
    return -widest(-grown)


def dice_loss(image: Tensor, target: Tensor) -> Tensor:
    """One minus the overlap 2 |A B| / (|A| + |B|), mean of that of the free space and that of the rest.

    Milletari et al., *V-Net* (2016), over the pixels of each sample.

    Args:
        image: (B, 4, H, W), layers in [-1, 1].
        target: Same shape.
    """
    free = free_share(probabilities(image))
    true_free = free_share(probabilities(target))
    of_free = _overlap(free, true_free)
    of_rest = _overlap(1.0 - free, 1.0 - true_free)
    return 1.0 - 0.5 * (of_free + of_rest)


def _overlap(a: Tensor, b: Tensor) -> Tensor:
    shared = _pixel_sum(a * b)
    total = _pixel_sum(a.square()) + _pixel_sum(b.square())
    overlaps = (2.0 * shared + 1.0) / (total + 1.0)
    return overlaps.mean()


def _pixel_sum(values: Tensor) -> Tensor:
    return values.sum(dim=(-2, -1))
