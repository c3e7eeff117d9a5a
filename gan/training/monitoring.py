"""How a training is watched: figures on held-out pairs, lines of progress, TensorBoard scalars, sample images.

The figures are taken without alignment, which the full evaluation (``slamgym gan evaluate``) adds.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from slamgym.core.files import own_folder, write_bytes
from slamgym.core.pictures import encode_png
from slamgym.core.progress import LINE_INTERVAL, duration, say
from slamgym.core.types import FREE, BoolArray, ByteArray, Float32Array, FloatArray
from slamgym.gan.config import TranslatorConfig
from slamgym.gan.data import PairSet
from slamgym.gan.device import Compute
from slamgym.gan.encoding import decode_slam, enlarge_means, free_probability
from slamgym.gan.networks.factory import Generator, run_generator
from slamgym.metrics import wall_score

WALL_TOLERANCE_M = 0.1
UNKNOWN_SCALE_TOLERANCE_PX = 2.0
LOSS_SMOOTHING = 0.98
"""Of the loss in lines of progress."""


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
    rows, probabilities = [], []
    for index, image in enumerate(translated):
        free = enlarge_means(free_probability(image, config.output_encoding), pairs.cad.shape[1:])
        probabilities.append(free)
        truth, scale = pairs.cad[index] > FREE // 2, pairs.scale(index)
        tolerance = WALL_TOLERANCE_M / scale if np.isfinite(scale) else UNKNOWN_SCALE_TOLERANCE_PX
        masks = free > 0.5, pairs.slam[index] == FREE
        errors = [float(np.mean(mask != truth)) for mask in masks]
        rows.append(errors + [wall_score(outline(mask), outline(truth), tolerance).f1 for mask in masks])
    mse, mse_slam, f1, f1_slam = np.array(rows).T
    return np.rint(np.stack(probabilities) * FREE).astype(np.uint8), {
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


class TrainingLog:
    """Writes lines of progress, and ``tensorboard/`` and ``samples/`` below a run's folder; use it as a context."""

    def __init__(self, folder: Path, first_step: int, enabled: bool = True) -> None:
        """Open the logs.

        Args:
            folder: Of the run.
            first_step: Where the training continues; what an interrupted run logged beyond it is hidden.
            enabled: Whether to write TensorBoard files (they need the package ``tensorboard``).
        """
        self._samples = folder / "samples"
        self._writer = _open_writer(own_folder(folder / "tensorboard"), first_step) if enabled else None
        self._began = self._last = time.monotonic()
        self._first: int | None = None
        self._loss: float | None = None

    def __enter__(self) -> "TrainingLog":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._writer is not None:
            self._writer.close()

    def scalars(self, group: str, values: Mapping[str, float], step: int) -> None:
        """Write values under ``group/``."""
        if self._writer is not None:
            for name, value in values.items():
                self._writer.add_scalar(f"{group}/{name}", value, step)

    def pictures(self, rows: ByteArray, step: int) -> None:
        """Write a grid of input, translation and target, one row each: (N, H, W) uint8."""
        grid = np.vstack(list(rows))
        write_bytes(own_folder(self._samples) / f"{step:07d}.png", encode_png(grid))
        if self._writer is not None:
            self._writer.add_image("samples", grid, step, dataformats="HW")

    def progress(self, images: int, total: int, loss: float, left: float | None = None) -> None:
        """Say now and then how far the training is.

        Args:
            images: How many are done.
            total: How many there shall be.
            loss: Of the last step.
            left: Seconds to go, where the cost of the coming steps is known; None goes by the rate so far, which
                is wrong as soon as the stages differ.
        """
        now = time.monotonic()
        if self._first is None or self._loss is None:
            self._first, self._began, self._loss = images, now, loss
        self._loss += (1.0 - LOSS_SMOOTHING) * (loss - self._loss)
        if now - self._last < LINE_INTERVAL and images < total:
            return
        self._last = now
        text = f"{100.0 * images / total:.1f} % of {total:,} images, loss {self._loss:.4g}"
        if images > self._first and now > self._began:
            rate = (images - self._first) / (now - self._began)
            to_go = (total - images) / rate if left is None else left
            text += f", {rate:.3g} images/s, {duration(to_go)} left"
        say(text)


def _open_writer(folder: Path, first_step: int) -> Any:
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        say("tensorboard isn't installed: no curves are written (pip install 'slamgym[gan]')")
        return None
    return SummaryWriter(str(folder), purge_step=first_step)
