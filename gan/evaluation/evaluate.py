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
from slamgym.gan.translation.classical import outline_only, thickened_walls, wall_growth
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

THRESHOLD = 0.5
"""Probability from which a pixel counts as free."""

RAW = "raw SLAM map"
"""Name of the method that leaves the SLAM map as it is."""
BLURRED = "raw SLAM map, blurred"
"""Name of the method that blurs the SLAM map's free space."""
THICKENED = "raw SLAM map, walls thickened"
"""Name of the method that makes the SLAM map's walls as thick as the CAD map's."""
CLEANED = "classical cleaning"
"""Name of the method that cleans the SLAM map without learning."""
OUTLINE_ONLY = "outline only (oracle)"
"""Name of the method that knows the CAD map and leaves out its inner walls."""
BLUR = 0.07
"""Standard deviation of that blur, about the displacement of walls by drift [m]."""


@dataclass(frozen=True)
class MapScore:
    """Result of one method on one map."""

    name: str
    plan_id: str
    metres_per_px: float
    measures: dict[str, float]
    """By name: those of :data:`slamgym.gan.evaluation.summary.MEASURES`, and the numbers of doors and walls."""
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

    The blurred map shows what greys alone do to the error, the thickened one what thick walls do, and the last one,
    which has seen the answer, what the error misses.
    """
    return [
        TranslationMethod(RAW, _free_space),
        TranslationMethod(BLURRED, _blurred),
        TranslationMethod(THICKENED, _thickened),
        TranslationMethod(CLEANED, _cleaned),
        TranslationMethod(OUTLINE_ONLY, _outline),
    ]


def _free_space(pairs: PairSet, index: int) -> Float32Array:
    free = pairs.slam[index] == FREE
    return free.astype(np.float32)


def _blurred(pairs: PairSet, index: int) -> Float32Array:
    sigma = BLUR / pairs.scale(index)
    blurred = cv2.GaussianBlur(_free_space(pairs, index), (0, 0), sigma)
    return np.asarray(blurred, dtype=np.float32)


def _thickened(pairs: PairSet, index: int) -> Float32Array:
    growth_px = wall_growth(pairs.cad[index], pairs.slam[index], pairs.scale(index))
    return thickened_walls(pairs.slam[index], growth_px).astype(np.float32)


def _cleaned(pairs: PairSet, index: int) -> Float32Array:
    return clean_map(pairs.slam[index], pairs.scale(index)).astype(np.float32)


def _outline(pairs: PairSet, index: int) -> Float32Array:
    return outline_only(pairs.cad[index], pairs.scale(index)).astype(np.float32)


def learned(name: str, translator: Translator, face_lines: float = 0.0) -> TranslationMethod:
    """A method that runs a translator.

    Args:
        name: Of the method.
        translator: Draws true faces.
        face_lines: Thickness of the line that the CAD maps have along every face, which the translation gets, too [px].
    """

    def predict(pairs: PairSet, index: int) -> Float32Array:
        floor = translator.translate(pairs.slam[index], pairs.scale(index))
        return shrunk_floor(floor, 0.5 * face_lines)

    return TranslationMethod(name, predict)


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
        slam = pairs.slam[i]
        begun = time.process_time()
        probability = np.asarray(method.predict(pairs, i))
        seconds = time.process_time() - begun
        _check_prediction(method.name, probability, slam.shape)
        score = score_map(probability, pairs.cad[i], pairs.scale(i), slam != UNKNOWN)
        score.measures["seconds"] = seconds
        scores.append(replace(score, name=pairs.names[i], plan_id=pairs.plan_ids[i]))
        if advance is not None:
            advance()
    return scores


def _check_prediction(name: str, probability: Float32Array, shape: tuple[int, ...]) -> None:
    if probability.shape != shape:
        raise ConfigError(f"{name} returned shape {probability.shape} for a map of shape {shape}")
    if not np.isfinite(probability).all():
        raise ConfigError(f"{name} returned values that are not finite; its weights may be damaged")


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
    found = aligned_error(_as_float(free), _as_float(truth), scaling=True)
    rigid = aligned_error(_as_float(free), _as_float(truth), scaling=False)
    placed = aligned_mask(free, found.similarity)
    rigidly = aligned_mask(free, rigid.similarity)
    as_drawn = apply_similarity(_as_float(predicted), found.similarity)

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
        "mse_grey": squared_error(as_drawn, _as_float(truth)),
        "wall_f1_10cm": wall_f1(placed, 0.1),
        "wall_f1_20cm": wall_f1(placed, 0.2),
        "free_iou": intersection_over_union(placed, truth),
        "hausdorff_95": min(boundary_distance(placed, truth, metres_per_px), farthest),
        "room_error": abs(rooms.count - rooms.true_count),
        "room_f1": rooms.f1,
        "mse_rigid": rigid.mse,
        "wall_f1_5cm_rigid": wall_f1(rigidly, 0.05),
        "wall_f1_10cm_rigid": wall_f1(rigidly, 0.1),
        "room_f1_rigid": room_score(rigidly, truth, metres_per_px).f1,
        "area_ratio": dimensions.area_ratio,
        "doors": openings.doors,
        "doors_kept": openings.doors_kept,
        "doors_invented": openings.doors_invented,
        "walls": openings.walls,
        "walls_opened": openings.walls_opened,
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
    rows, cols = values.shape
    return keep_thin_walls(moved, drawing, similarity.matrix(rows, cols))


def aligned_mask(free: BoolArray, similarity: Similarity) -> BoolArray:
    """A mask after a similarity."""
    return _placed(free, similarity) >= THRESHOLD


def evenly_spaced(count: int, wanted: int) -> Sequence[int]:
    """At most ``wanted`` indices below ``count``, evenly spaced: a choice that doesn't depend on the results."""
    if count == 0:
        return []
    places = np.linspace(0, count - 1, min(wanted, count)).round()
    return [int(place) for place in np.unique(places)]
