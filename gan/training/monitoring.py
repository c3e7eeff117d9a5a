"""Monitoring of a training: figures and sample images of held-out pairs, lines of progress.

The figures are taken without alignment, which the full evaluation (``slamgym gan evaluate``) adds.
"""

import time

import numpy as np

from slamgym.core.progress import LINE_INTERVAL, duration, say
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, BoolArray, ByteArray, Float32Array
from slamgym.gan.config import TranslatorConfig
from slamgym.gan.data import PairSet
from slamgym.gan.device import Compute
from slamgym.gan.encoding import decode_slam, enlarge_means, free_probability
from slamgym.gan.networks.factory import Generator, run_generator
from slamgym.metrics import boundary_score

WALL_TOLERANCE = 0.1
"""Tolerance of the wall F1 [m]."""


def validate(
    generator: Generator,
    pairs: PairSet,
    config: TranslatorConfig,
    compute: Compute,
    resolution: int,
    pictures: int = 8,
) -> tuple[dict[str, float], ByteArray]:
    """Translate held-out pairs and compare.

    For ``slam2cad``: ``mse`` of the free space against the CAD map, ``mse_slam`` of the SLAM map itself, their
    ``mse_ratio`` and ``improved`` share, and ``wall_f1`` and ``wall_f1_slam``. For ``cad2slam``: the shares of free,
    occupied and unknown cells, translated less true, and the mean absolute difference of the cells' greys.

    Returns:
        Means over the pairs, and a grid of input, translation and target, (rows, cols).
    """
    to_cad = config.direction == "slam2cad"
    inputs = pairs.slam if to_cad else pairs.cad
    targets = pairs.cad if to_cad else pairs.slam
    translated = run_generator(generator, inputs, config, compute, resolution)
    if to_cad:
        shown, figures = _validate_cad(translated, pairs, config)
    else:
        shown, figures = _validate_slam(translated, targets, config)
    count = min(pictures, len(pairs))
    rows = [np.hstack([inputs[i], shown[i], targets[i]]) for i in range(count)]
    return figures, np.vstack(rows)


def _validate_cad(
    translated: Float32Array, pairs: PairSet, config: TranslatorConfig
) -> tuple[ByteArray, dict[str, float]]:
    probabilities = []
    drawn_scores = []
    slam_scores = []
    for index, image in enumerate(translated):
        probability = free_probability(image, config.output_encoding)
        free = enlarge_means(probability, pairs.cad.shape[1:])
        probabilities.append(free)
        truth = pairs.cad[index] > FREE // 2
        scale = pairs.usual_scale(index)
        drawn_scores.append(_error_and_f1(free > 0.5, truth, scale))
        slam_scores.append(_error_and_f1(pairs.slam[index] == FREE, truth, scale))
    mse, f1 = np.array(drawn_scores).T
    mse_slam, f1_slam = np.array(slam_scores).T
    shown = np.rint(np.stack(probabilities) * FREE).astype(np.uint8)
    return shown, {
        "mse": float(mse.mean()),
        "mse_slam": float(mse_slam.mean()),
        "mse_ratio": float(mse.mean() / max(mse_slam.mean(), 1e-9)),
        "improved": float(np.mean(mse < mse_slam)),
        "wall_f1": float(f1.mean()),
        "wall_f1_slam": float(f1_slam.mean()),
    }


def _error_and_f1(free: BoolArray, truth: BoolArray, metres_per_px: float) -> tuple[float, float]:
    """Mean squared error of a mask, and its wall F1."""
    error = float(np.mean(free != truth))
    return error, boundary_score(free, truth, metres_per_px, WALL_TOLERANCE).f1


def _validate_slam(
    translated: Float32Array, targets: ByteArray, config: TranslatorConfig
) -> tuple[ByteArray, dict[str, float]]:
    factor = targets.shape[-1] // translated.shape[-1]
    cells = np.stack([decode_slam(image, config.output_encoding) for image in translated])
    shown = cells.repeat(factor, axis=1).repeat(factor, axis=2)
    differences = shown.astype(np.int16) - targets.astype(np.int16)
    return shown, {
        "grey_difference": float(np.abs(differences).mean()),
        "occupied_excess": _excess(shown, targets, OCCUPIED),
        "unknown_excess": _excess(shown, targets, UNKNOWN),
        "free_excess": _excess(shown, targets, FREE),
    }


def _excess(cells: ByteArray, true_cells: ByteArray, value: int) -> float:
    """Share of the cells of a value, less that of the true ones."""
    share = np.mean(cells == value)
    true_share = np.mean(true_cells == value)
    return float(share - true_share)


class ProgressLines:
    """Says now and then how far a training is."""

    def __init__(self) -> None:
        self._last = time.monotonic()
        self._first: tuple[float, float] | None = None

    def show(self, share: float, loss: float) -> None:
        """Say how far the training is, if it is time for a line.

        Args:
            share: Share of the training that is done.
            loss: Of the last step.
        """
        now = time.monotonic()
        if self._first is None:
            self._first = now, share
        since, first = self._first
        if now - self._last < LINE_INTERVAL or share <= first:
            return
        self._last = now
        seconds_left = max(0.0, 1.0 - share) * (now - since) / (share - first)
        say(f"{100.0 * share:.1f} %, loss {loss:.4g}, {duration(seconds_left)} left")
