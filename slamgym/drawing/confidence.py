"""Walls, split where what was seen of them begins and ends, and how sure each piece is.

What a drawing looks like around a wall says most of it: true walls are long and straight, and where pieces are short an
outline follows furniture, clutter or rays. What lies behind it comes next: a wall with rooms on both sides is surer
than one with nothing known behind it.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely

from slamgym.core.types import BoolArray, FloatArray
from slamgym.drawing.drawing import DrawnWall, Layer
from slamgym.drawing.evidence import Evidence
from slamgym.drawing.walls import ANTIPARALLEL, WallPiece

SHORTEST_CHANGE = 0.4
"""A wall is split into seen and inferred pieces of at least this length [m]."""
NEAR, AROUND = 0.5, 2.0
"""How far around a wall the drawing is looked at [m]."""
LONG = 3.0
"""Walls that are longer aren't surer for it [m]."""
TOUCHING = 0.05
"""Parallel pieces so near to each other are one straight wall [m]."""


@dataclass(frozen=True)
class Confidence:
    """Coefficients of a logistic function: the probability that a true wall lies within 20 cm of a drawn one.

    Fitted and tried on simulated homes of other plans (``benchmarks/drawing/wall_confidence.py``,
    docs/drawing/quality.md). The model's certainty and a wall's thickness said nothing beside these.
    """

    constant: float
    seen: float
    """Of the share of its length that was seen."""
    hidden: float
    """Of the share of the space behind it that is unknown."""
    straight: float
    """Of the length of the straight wall that it is part of, up to :data:`LONG` [1/m]."""
    ragged_near: float
    """Of the logarithm of the pieces of wall per metre within :data:`NEAR`."""
    ragged_around: float
    """Of the same within :data:`AROUND`."""

    def of(self, signs: FloatArray) -> FloatArray:
        """Probabilities, from :func:`wall_signs`."""
        weights = [self.seen, self.hidden, self.straight, self.ragged_near, self.ragged_around]
        result: FloatArray = 1.0 / (1.0 + np.exp(-(self.constant + signs @ np.array(weights))))
        return result


DEFAULT_CONFIDENCE = Confidence(1.05, 0.33, -0.66, 0.46, -0.74, -0.74)


def judged_walls(pieces: list[WallPiece], evidence: Evidence) -> list[DrawnWall]:
    """Split walls where the evidence begins and ends, and say how sure each piece is."""
    parts = [part for piece in pieces for part in _split(piece, evidence.seen_along(piece))]
    signs = wall_signs(parts, evidence)
    walls = []
    for part, seen, sure in zip(
        parts, signs[:, 0].tolist(), DEFAULT_CONFIDENCE.of(signs).tolist(), strict=True
    ):
        layer: Layer = "SEEN" if seen >= evidence.config.seen_share else "INFERRED"
        start, end = part.centre_line
        walls.append(DrawnWall(part.body, start, end, part.thickness, part.known, sure, seen, layer))
    return walls


def wall_signs(walls: Sequence[WallPiece], evidence: Evidence) -> FloatArray:
    """What tells true walls from others, shape (N, 5), in the order of the coefficients of :class:`Confidence`."""
    seen = [float(evidence.seen_along(wall).mean()) for wall in walls]
    hidden = [evidence.hidden_behind(wall) for wall in walls]
    ends = np.array([wall.centre_line for wall in walls]).reshape(-1, 2, 2)
    lines: Any = shapely.linestrings(ends)
    one, other = shapely.STRtree(lines).query(lines, predicate="dwithin", distance=AROUND)
    apart: FloatArray = shapely.distance(lines[one], lines[other])
    across = ends[:, 1] - ends[:, 0]
    length = np.hypot(*across.T)

    def total(chosen: BoolArray, values: FloatArray) -> Any:
        return np.bincount(one[chosen], values[other[chosen]], minlength=len(walls))

    along = np.abs(np.einsum("ij,ij->i", across[one], across[other]))
    is_parallel = along >= ANTIPARALLEL * length[one] * length[other]
    straight = total((apart <= TOUCHING) & is_parallel, length)
    ragged = [
        np.log(total(apart <= r, np.ones_like(length)) / total(apart <= r, length)) for r in (NEAR, AROUND)
    ]
    return np.column_stack([seen, hidden, np.minimum(straight, LONG), *ragged])


def _split(piece: WallPiece, seen: BoolArray) -> list[WallPiece]:
    """Pieces that were seen or not, none shorter than :data:`SHORTEST_CHANGE`."""
    least = math.ceil(SHORTEST_CHANGE / (piece.length / len(seen)))
    runs = _runs(seen)
    while len(runs) > 1 and min(high - low for low, high in runs) < least:
        shortest = min(range(len(runs)), key=lambda k: runs[k][1] - runs[k][0])
        low, high = max(shortest - 1, 0), min(shortest + 1, len(runs) - 1)
        runs[low : high + 1] = [(runs[low][0], runs[high][1])]
    start, end = np.array(piece.start), np.array(piece.end)
    parts = []
    for index, (low, high) in enumerate(runs):
        first, last = (start + place / len(seen) * (end - start) for place in (low, high))
        parts.append(
            replace(
                piece,
                start=(float(first[0]), float(first[1])),
                end=(float(last[0]), float(last[1])),
                before=piece.before if index == 0 else 0.0,
                after=piece.after if index == len(runs) - 1 else 0.0,
            )
        )
    return parts


def _runs(values: BoolArray) -> list[tuple[int, int]]:
    changes = np.flatnonzero(np.diff(values)) + 1
    marks = [0, *changes.tolist(), len(values)]
    return list(itertools.pairwise(marks))
