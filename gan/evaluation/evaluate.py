"""Measure translated maps against CAD drawings: the paper's aligned error, and what it can't see.

Every method, the SLAM map itself included, goes through the same steps: threshold, the same alignment search on its
own, keep the better of aligned and unaligned, then all measures in that position. That is done twice: with a
similarity, as in the paper, and with a rigid motion, which can't enlarge a drawing until it fits. Dimensions are
measured in the second.
"""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from slamgym.core.errors import ConfigError
from slamgym.core.types import FREE, UNKNOWN, BoolArray, ByteArray, Float32Array, FloatArray
from slamgym.gan.data import PairSet
from slamgym.gan.translation.classical import outline_only
from slamgym.gan.translation.finishing import shrunk_floor
from slamgym.gan.translation.translate import Translator
from slamgym.metrics import (
    Dimensions,
    Openings,
    Similarity,
    aligned_error,
    apply_similarity,
    boundary_distance,
    boundary_score,
    compare_openings,
    intersection_over_union,
    measure_dimensions,
    room_score,
    squared_error,
    unseen_share,
)
from slamgym.metrics.alignment import IDENTITY
from slamgym.metrics.cleaning import clean_map
from slamgym.metrics.maps import keep_thin_walls

TOLERANCES = (0.1, 0.2)
"""Tolerances of the wall F1 [m]."""
RIGID_TOLERANCES = (0.05, 0.1)
"""Tolerances of the wall F1 after a rigid alignment [m]."""
OPENINGS = ("doors", "doors_kept", "doors_invented", "walls", "walls_opened")
"""Numbers of doors and walls that are measures of a map."""
THRESHOLD = 0.5
"""Probability from which a pixel counts as free."""

RAW, CLEANED, OUTLINE = "raw SLAM map", "classical cleaning", "outline only (oracle)"
BLURRED = "raw SLAM map, blurred"
BLUR = 0.07
"""Standard deviation of that blur, about the displacement of walls by drift [m]."""


@dataclass(frozen=True)
class MapScore:
    """Result of one method on one map."""

    name: str
    plan_id: str
    metres_per_px: float
    measures: dict[str, float]
    """By name: those of :data:`slamgym.gan.evaluation.summary.MEASURES` and :data:`OPENINGS`."""
    dimensions: Dimensions = field(default_factory=Dimensions)
    openings: Openings = field(default_factory=Openings)

    def __getitem__(self, measure: str) -> float:
        return self.measures[measure]

    @property
    def mse(self) -> float:
        """Aligned mean squared error of the free-space masks: MSE1 of a translation, MSE2 of the SLAM map."""
        return self.measures["mse"]


@dataclass(frozen=True)
class TranslationMethod:
    """A translator from SLAM map to CAD map, under the name that tables show."""

    name: str
    predict: Callable[[PairSet, int], Float32Array]
    """The probability of free space (H, W) for one pair of a set."""


def baselines() -> list[TranslationMethod]:
    """Baselines that every translator is compared with.

    The blurred map shows what greys alone do to the error, and the last one, which has seen the answer, what the error
    misses.
    """
    return [
        TranslationMethod(RAW, lambda pairs, i: _probability(pairs.slam[i] == FREE)),
        TranslationMethod(
            BLURRED, lambda pairs, i: _blurred(pairs.slam[i] == FREE, pairs.scale(i))
        ),
        TranslationMethod(
            CLEANED, lambda pairs, i: _probability(clean_map(pairs.slam[i], pairs.scale(i)))
        ),
        TranslationMethod(
            OUTLINE, lambda pairs, i: _probability(outline_only(pairs.cad[i], pairs.scale(i)))
        ),
    ]


def _probability(free: BoolArray) -> Float32Array:
    return free.astype(np.float32)


def _blurred(free: BoolArray, metres_per_px: float) -> Float32Array:
    blurred = cv2.GaussianBlur(_probability(free), (0, 0), BLUR / metres_per_px)
    return np.asarray(blurred, dtype=np.float32)


def learned(name: str, translator: Translator, face_lines: float = 0.0) -> TranslationMethod:
    """A method that runs a translator.

    Args:
        name: Of the method.
        translator: Draws true faces.
        face_lines: Thickness of the line that the CAD maps have along every face, which the translation gets, too [px].
    """
    return TranslationMethod(
        name,
        lambda pairs, i: shrunk_floor(
            translator.translate(pairs.slam[i], pairs.scale(i)), 0.5 * face_lines
        ),
    )


def evaluate_method(
    method: TranslationMethod, pairs: PairSet, advance: Callable[[], None] | None = None
) -> list[MapScore]:
    """Score a method on every pair.

    Args:
        method: What to measure.
        pairs: Held-out pairs; their scale must be known.
        advance: Called after each map.

    Raises:
        ConfigError: If the scale of a pair isn't known, or the method returns a malformed image.
    """
    if not np.isfinite(pairs.metres_per_px).all():
        raise ConfigError(
            "the images have no scale: the evaluation in metres needs the manifest.jsonl that "
            "`slamgym dataset render` writes beside them"
        )
    scores = []
    for i in range(len(pairs)):
        begun = time.process_time()
        probability = np.asarray(method.predict(pairs, i))
        seconds = time.process_time() - begun
        shape = pairs.slam[i].shape
        if probability.shape != shape:
            raise ConfigError(
                f"{method.name} returned shape {probability.shape} for a map of shape {shape}"
            )
        if not np.isfinite(probability).all():
            raise ConfigError(
                f"{method.name} returned values that are not finite; its weights may be damaged"
            )
        score = score_map(probability, pairs.cad[i], pairs.scale(i), pairs.slam[i] != UNKNOWN)
        score.measures["seconds"] = seconds
        scores.append(replace(score, name=pairs.names[i], plan_id=pairs.plan_ids[i]))
        if advance is not None:
            advance()
    return scores


def score_map(
    predicted: BoolArray | Float32Array,
    cad: ByteArray,
    metres_per_px: float,
    seen: BoolArray | None = None,
) -> MapScore:
    """Score one map.

    Args:
        predicted: Free cells, or the probability of being free, shape (H, W).
        cad: CAD map of the same shape and frame: 0 walls and outside, 254 inside, greys where a face crosses a pixel.
        metres_per_px: Scale [m].
        seen: Cells that the robot saw, same shape; without them ``unseen_share`` is nan.
    """
    truth: BoolArray = cad > 127
    free: BoolArray = predicted >= THRESHOLD
    found, rigid = (
        aligned_error(_as_float(free), _as_float(truth), scaling=s) for s in (True, False)
    )
    placed, rigidly = aligned_mask(free, found.similarity), aligned_mask(free, rigid.similarity)

    def wall_f1(mask: BoolArray, tolerance: float) -> float:
        return boundary_score(mask, truth, metres_per_px, tolerance).f1

    rooms = room_score(placed, truth, metres_per_px)
    shares = _placed(predicted, rigid.similarity)
    true_shares = (cad / np.float32(FREE)).astype(np.float32)
    dimensions = measure_dimensions(shares, true_shares, metres_per_px)
    openings = compare_openings(shares, true_shares, metres_per_px)
    # A map without any wall is as far off as the image is wide, so that means stay finite.
    farthest = metres_per_px * math.hypot(*truth.shape)
    measures = {
        "mse": found.mse,
        "mse_grey": squared_error(
            apply_similarity(_as_float(predicted), found.similarity), _as_float(truth)
        ),
        **{f"wall_f1_{round(100 * t)}cm": wall_f1(placed, t) for t in TOLERANCES},
        "free_iou": intersection_over_union(placed, truth),
        "hausdorff_95": min(boundary_distance(placed, truth, metres_per_px), farthest),
        "room_error": abs(rooms.count - rooms.true_count),
        "room_f1": rooms.f1,
        "mse_rigid": rigid.mse,
        **{f"wall_f1_{round(100 * t)}cm_rigid": wall_f1(rigidly, t) for t in RIGID_TOLERANCES},
        "room_f1_rigid": room_score(rigidly, truth, metres_per_px).f1,
        "area_ratio": dimensions.area_ratio,
        **{name: getattr(openings, name) for name in OPENINGS},
        "unseen_share": math.nan if seen is None else unseen_share(free, seen),
        "seconds": 0.0,
    }
    return MapScore("", "", metres_per_px, measures, dimensions, openings)


def _as_float(values: np.ndarray) -> FloatArray:
    return values.astype(np.float64)


def _placed(values: BoolArray | Float32Array, similarity: Similarity) -> Float32Array:
    """A drawing after a similarity, with the walls it had; untouched by resampling if that does nothing."""
    drawing = np.asarray(values, dtype=np.float32)
    if similarity == IDENTITY:
        return drawing
    moved = apply_similarity(_as_float(values), similarity).astype(np.float32)
    return keep_thin_walls(moved, drawing, similarity.matrix(*values.shape))


def aligned_mask(free: BoolArray, similarity: Similarity) -> BoolArray:
    """A mask after a similarity."""
    return _placed(free, similarity) >= THRESHOLD


def evenly_spaced(count: int, wanted: int) -> Sequence[int]:
    """At most ``wanted`` indices below ``count``, evenly spaced: a choice that doesn't depend on the results."""
    return (
        [int(i) for i in np.unique(np.linspace(0, count - 1, min(wanted, count)).round())]
        if count
        else []
    )
