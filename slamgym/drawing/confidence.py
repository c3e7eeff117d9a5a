"""Walls, split where what was seen of them begins and ends, and how sure each piece is.

What a drawing looks like around a wall says most of it: where pieces are short an outline follows furniture, clutter or
rays. What lies behind it comes next: a wall with rooms on both sides is surer than one with nothing known behind it.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import shapely

from slamgym.core.types import BoolArray, FloatArray
from slamgym.drawing.drawing import DrawnWall, Layer
from slamgym.drawing.evidence import Evidence
from slamgym.drawing.settings import SEEN_SHARE
from slamgym.drawing.walls import WallPiece

SHORTEST_CHANGE = 0.4
"""A wall is split into seen and inferred pieces of at least this length [m]."""
NEAR_WALL = 0.5
"""Distance around a wall within which pieces of wall are counted [m]."""
CONSTANT, WEIGHTS = 2.15, np.array([1.55, -1.4, -1.44])
"""Coefficients of a logistic function of :func:`wall_signs`: the probability that a true wall lies within 20 cm.

Fitted on simulated homes (``benchmarks/drawing/wall_confidence.py``, docs/drawing/quality.md). The length of a wall,
the model's certainty and the thickness said nothing more."""


def confidences(signs: FloatArray) -> FloatArray:
    """Probabilities that a true wall lies within 20 cm of drawn ones, from :func:`wall_signs`."""
    return 1.0 / (1.0 + np.exp(-(CONSTANT + signs @ WEIGHTS)))


def judged_walls(pieces: list[WallPiece], evidence: Evidence) -> list[DrawnWall]:
    """Split walls where the evidence begins and ends, and say how sure each piece is."""
    parts = [part for piece in pieces for part in _split(piece, evidence.seen_along(piece))]
    signs = wall_signs(parts, evidence)
    walls = []
    for part, seen, sure in zip(
        parts, signs[:, 0].tolist(), confidences(signs).tolist(), strict=True
    ):
        layer: Layer = "SEEN" if seen >= SEEN_SHARE else "INFERRED"
        start, end = map(tuple, part.centre_line.tolist())
        walls.append(
            DrawnWall(start, end, part.body, part.thickness, part.known, sure, seen, layer)
        )
    return walls


def wall_signs(walls: Sequence[WallPiece], evidence: Evidence) -> FloatArray:
    """The signs that tell true walls from others, shape (N, 3).

    They are the share of a wall's length that was seen, the share of the space behind it that is unknown, and the
    logarithm of the pieces of wall per metre within :data:`NEAR_WALL`.
    """
    seen = [float(evidence.seen_along(wall).mean()) for wall in walls]
    hidden = [evidence.hidden_behind(wall) for wall in walls]
    lines: Any = shapely.linestrings(
        np.array([wall.centre_line for wall in walls]).reshape(-1, 2, 2)
    )
    one, other = shapely.STRtree(lines).query(lines, predicate="dwithin", distance=NEAR_WALL)
    metres = np.bincount(one, shapely.length(lines)[other], minlength=len(walls))
    return np.column_stack([seen, hidden, np.log(np.bincount(one, minlength=len(walls)) / metres)])


def _split(piece: WallPiece, seen: BoolArray) -> list[WallPiece]:
    """Split a wall into pieces that were seen or not, none shorter than :data:`SHORTEST_CHANGE`."""
    least = math.ceil(SHORTEST_CHANGE / (piece.length / len(seen)))
    runs = list(itertools.pairwise([0, *(np.flatnonzero(np.diff(seen)) + 1).tolist(), len(seen)]))
    while len(runs) > 1 and min(high - low for low, high in runs) < least:
        shortest = min(range(len(runs)), key=lambda k: runs[k][1] - runs[k][0])
        low, high = max(shortest - 1, 0), min(shortest + 1, len(runs) - 1)
        runs[low : high + 1] = [(runs[low][0], runs[high][1])]
    parts = []
    for low, high in runs:
        start, end = (
            piece.start + place / len(seen) * (piece.end - piece.start) for place in (low, high)
        )
        before, after = piece.before if low == 0 else 0.0, piece.after if high == len(seen) else 0.0
        parts.append(replace(piece, start=start, end=end, before=before, after=after))
    return parts
