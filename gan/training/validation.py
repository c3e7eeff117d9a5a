"""How good a generator is on held-out pairs, quickly, while it trains.

The figures are taken without alignment, which the full evaluation (``slamgym gan evaluate``) adds.
"""

from dataclasses import dataclass

import numpy as np

from slamgym.core.types import FREE, BoolArray, ByteArray, Float32Array, FloatArray
from slamgym.gan.config import TranslatorConfig
from slamgym.gan.data import PairSet
from slamgym.gan.device import Compute
from slamgym.gan.encoding import decode_slam, enlarge_means, free_probability
from slamgym.gan.networks.factory import Generator, run_generator
from slamgym.metrics import wall_score

WALL_TOLERANCE_M = 0.1
UNKNOWN_SCALE_TOLERANCE_PX = 2.0


@dataclass(frozen=True)
class ValidationResult:
    """Means over the held-out pairs."""

    figures: dict[str, float]
    pictures: ByteArray  # (N, H, 3 * W): input, translation, target


def validate(
    generator: Generator,
    pairs: PairSet,
    config: TranslatorConfig,
    compute: Compute,
    resolution: int,
    pictures: int = 8,
) -> ValidationResult:
    """Translate held-out pairs and compare.

    For ``slam2cad``: ``mse`` of the free space against the CAD map, ``mse_slam`` of the SLAM map itself, their
    ``mse_ratio`` and ``improved`` share, ``wall_f1`` beside ``wall_f1_slam``, and ``calibration_error``. For
    ``cad2slam``: the shares of free, occupied and unknown cells, translated less true, and the mean absolute difference
    of the cells' greys.
    """
    to_cad = config.direction == "slam2cad"
    inputs, targets = (pairs.slam, pairs.cad) if to_cad else (pairs.cad, pairs.slam)
    translated = run_generator(generator, inputs, config, compute, resolution)
    if to_cad:
        shown, figures = _validate_cad(translated, pairs, config)
    else:
        shown, figures = _validate_slam(translated, targets, config)
    rows = [np.hstack([inputs[i], shown[i], targets[i]]) for i in range(min(pictures, len(pairs)))]
    return ValidationResult(figures, np.stack(rows))


def _validate_cad(
    translated: Float32Array, pairs: PairSet, config: TranslatorConfig
) -> tuple[ByteArray, dict[str, float]]:
    shape = pairs.cad.shape[1:]
    rows: list[tuple[float, float, float, float]] = []
    probabilities = []
    shown = np.empty_like(pairs.cad)
    for index, image in enumerate(translated):
        free = enlarge_means(free_probability(image, config.output_encoding), (shape[0], shape[1]))
        shown[index] = np.rint(free * FREE)
        probabilities.append(free)
        truth = pairs.cad[index] > FREE // 2
        slam = pairs.slam[index] == FREE
        tolerance = _tolerance_px(pairs.scale(index))
        walls = outline(truth)
        rows.append(
            (
                float(np.mean(((free > 0.5) != truth))),
                float(np.mean(slam != truth)),
                wall_score(outline(free > 0.5), walls, tolerance).f1,
                wall_score(outline(slam), walls, tolerance).f1,
            )
        )
    mse, mse_slam, f1, f1_slam = np.array(rows).T
    return shown, {
        "mse": float(mse.mean()),
        "mse_slam": float(mse_slam.mean()),
        "mse_ratio": float(mse.mean() / max(mse_slam.mean(), 1e-9)),
        "improved": float(np.mean(mse < mse_slam)),
        "wall_f1": float(f1.mean()),
        "wall_f1_slam": float(f1_slam.mean()),
        "calibration_error": calibration_error(np.stack(probabilities), pairs.cad.astype(np.float32) / FREE),
    }


def calibration_error(probabilities: Float32Array, shares: FloatArray) -> float:
    """How far probabilities are from what happens: expected calibration error (Guo et al. 2017) of the unsure pixels.

    Args:
        probabilities: Of floor, any shape.
        shares: Of floor in truth, same shape.

    Returns:
        Mean over pixels between 0.05 and 0.95, in ten bins, of |mean probability - mean share|; 0 if there are none.
    """
    unsure = (probabilities > 0.05) & (probabilities < 0.95)
    given, true = probabilities[unsure].astype(np.float64), shares[unsure].astype(np.float64)
    bins = np.minimum((given * 10.0).astype(np.int64), 9)
    differences = np.abs(np.bincount(bins, given, 10) - np.bincount(bins, true, 10))
    return float(differences.sum() / max(len(given), 1))


def _validate_slam(
    translated: Float32Array, targets: ByteArray, config: TranslatorConfig
) -> tuple[ByteArray, dict[str, float]]:
    side = targets.shape[1]
    factor = side // translated.shape[-1]
    cells = np.stack([decode_slam(image, config.output_encoding) for image in translated])
    shown = cells.repeat(factor, axis=1).repeat(factor, axis=2)
    difference = np.abs(shown.astype(np.int16) - targets.astype(np.int16))
    figures = {"grey_difference": float(difference.mean())}
    for name, value in (("occupied", 0), ("unknown", 205), ("free", 254)):
        figures[f"{name}_excess"] = float(np.mean(shown == value) - np.mean(targets == value))
    return shown, figures


def outline(free: BoolArray) -> BoolArray:
    """Cells that aren't free but have a free neighbour above, below or beside: the faces of the walls."""
    near = np.zeros_like(free)
    near[1:] |= free[:-1]
    near[:-1] |= free[1:]
    near[:, 1:] |= free[:, :-1]
    near[:, :-1] |= free[:, 1:]
    edge: BoolArray = near & ~free
    return edge


def _tolerance_px(metres_per_px: float) -> float:
    return WALL_TOLERANCE_M / metres_per_px if np.isfinite(metres_per_px) else UNKNOWN_SCALE_TOLERANCE_PX
