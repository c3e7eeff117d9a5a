"""What this package claims of its own translator, with true faces: it is compared with the map that it was given.

A map with thicker walls has a lower error for nothing, so the translator is compared with that, too.
"""

from __future__ import annotations

import csv
import io
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from slamgym.commands.reproduce.steps import OWN_NETWORK, TRAINED
from slamgym.commands.reproduce.verdicts import with_interval
from slamgym.core.files import read_text
from slamgym.core.intervals import mean_interval
from slamgym.core.types import FloatArray
from slamgym.gan.evaluation.evaluate import RAW, THICKENED
from slamgym.gan.evaluation.summary import MEASURES

Scores = dict[str, list[dict[str, str]]]
"""By method the lines of its maps, which are the same maps in the same order."""


class OwnMeasure(NamedTuple):
    """A measure of :data:`slamgym.gan.evaluation.summary.MEASURES`."""

    name: str
    sign: float
    """1 where more is better, -1 where less is."""


OWN_MEASURES = (
    OwnMeasure("mse", -1.0),
    OwnMeasure("wall_f1_10cm", 1.0),
    OwnMeasure("wall_f1_10cm_rigid", 1.0),
    OwnMeasure("room_error", -1.0),
    OwnMeasure("room_f1", 1.0),
)
"""What a translator is compared by."""


def read_scores(evaluation: Path) -> Scores:
    """Read ``scores.csv`` of ``slamgym gan evaluate``.

    Raises:
        InputFileError: If it can't be read.
    """
    scores: Scores = defaultdict(list)
    for row in csv.DictReader(io.StringIO(read_text(evaluation / "scores.csv"))):
        scores[row["method"]].append(row)
    return dict(scores)


def own_claims(scores: Scores) -> tuple[list[str], list[list[str]]]:
    """Headings and rows: this package's translators beside the map itself, by measure."""
    networks = [name for name in (OWN_NETWORK, TRAINED[OWN_NETWORK]) if name in scores]
    rows = [_compared(scores, network, measure) for network in networks for measure in OWN_MEASURES]
    headings = [
        "translator",
        "measure",
        "translated",
        RAW,
        THICKENED,
        f"against {RAW}",
        f"against {THICKENED}",
    ]
    return headings, rows


def _compared(scores: Scores, network: str, measure: OwnMeasure) -> list[str]:
    """A measure of a translator's maps beside those of the maps themselves."""
    plans = [row["plan_id"] for row in scores[network]]
    own = _column(scores[network], measure.name)
    raw = _column(scores[RAW], measure.name)
    thickened = _column(scores[THICKENED], measure.name)
    means = [mean_interval(values, groups=plans) for values in (own, raw, thickened)]
    words = [_word(measure.sign * (own - other), plans) for other in (raw, thickened)]
    shown = [with_interval(mean, 3) for mean in means]
    return [network, MEASURES[measure.name], *shown, *words]


def _column(rows: Sequence[dict[str, str]], measure: str) -> FloatArray:
    return np.array([float(row[measure]) for row in rows])


def _word(gains: FloatArray, plans: list[str]) -> str:
    """What the gains, map by map, say.

    Args:
        gains: Positive where the translation is better, shape (N,).
        plans: The plan of each map.
    """
    mean = mean_interval(gains, groups=plans)
    if mean.low > 0.0:
        return "better"
    if mean.high < 0.0:
        return "worse"
    return "too few maps to say"
