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
from slamgym.drawing.settings import MAJORITY
from slamgym.drawing.walls import WallPiece

SHORTEST_CHANGE = 0.4
"""A wall is split into seen and inferred pieces of at least this length [m]. Without it 57 real maps
have 11 % more walls."""
NEAR_WALL = 0.5
"""Distance around a wall within which pieces of wall are counted [m]."""
WALL_CONSTANT = 2.15
"""Constant of a logistic function of :func:`wall_signs`: the probability that a true wall lies within 20 cm.

Fitted on simulated homes (``benchmarks/drawing/wall_confidence.py``, docs/drawing/quality.md)."""
WALL_WEIGHTS = np.array([1.55, -1.4, -1.44])
"""Coefficients of the signs in the same function, one each.

The length of a wall, the model's certainty and the thickness said nothing more."""


def confidences(signs: FloatArray) -> FloatArray:
    """Probabilities that a true wall lies within 20 cm of drawn ones, from :func:`wall_signs`."""
    log_odds = WALL_CONSTANT + signs @ WALL_WEIGHTS
    return 1.0 / (1.0 + np.exp(-log_odds))


def judged_walls(pieces: list[WallPiece], evidence: Evidence) -> list[DrawnWall]:
    """Split walls where the evidence begins and ends, and say how sure each piece is."""
    parts = []
    for piece in pieces:
        parts += _split(piece, evidence.seen_along(piece))
    signs = wall_signs(parts, evidence)
    shares_seen = signs[:, 0].tolist()
    sure = confidences(signs).tolist()
    judged = zip(parts, shares_seen, sure, strict=True)
    return [_drawn(part, share_seen, confidence) for part, share_seen, confidence in judged]


def _drawn(piece: WallPiece, share_seen: float, confidence: float) -> DrawnWall:
    """A piece of wall as drawings have it."""
    start, end = map(tuple, piece.centre_line.tolist())
    layer: Layer = "SEEN" if share_seen >= MAJORITY else "INFERRED"
    return DrawnWall(
        start=start,
        end=end,
        polygon=piece.body,
        thickness=piece.thickness,
        thickness_known=piece.known,
        confidence=confidence,
        share_seen=share_seen,
        layer=layer,
    )


def wall_signs(walls: Sequence[WallPiece], evidence: Evidence) -> FloatArray:
    """The signs that tell true walls from others, shape (N, 3).

    They are the share of a wall's length that was seen, the share of the space behind it that is unknown, and the
    logarithm of the pieces of wall per metre within :data:`NEAR_WALL`.
    """
    seen = [float(evidence.seen_along(wall).mean()) for wall in walls]
    hidden = [evidence.hidden_behind(wall) for wall in walls]
    count = len(walls)
    centre_lines = [wall.centre_line for wall in walls]
    ends = np.array(centre_lines).reshape(-1, 2, 2)
    lines: Any = shapely.linestrings(ends)
    tree = shapely.STRtree(lines)
    one, other = tree.query(lines, predicate="dwithin", distance=NEAR_WALL)
    length = shapely.length(lines)
    metres_around = np.bincount(one, length[other], minlength=count)
    pieces_around = np.bincount(one, minlength=count)
    pieces_per_metre = np.log(pieces_around / metres_around)
    return np.column_stack([seen, hidden, pieces_per_metre])


def _split(piece: WallPiece, seen: BoolArray) -> list[WallPiece]:
    """Split a wall into pieces that were seen or not, none shorter than :data:`SHORTEST_CHANGE`."""
    step = piece.length / len(seen)
    runs = _long_runs(seen, math.ceil(SHORTEST_CHANGE / step))
    return [piece_between(piece, low / len(seen), high / len(seen)) for low, high in runs]


def _long_runs(seen: BoolArray, least: int) -> list[tuple[int, int]]:
    """Where runs of the seen and of the unseen begin and end; shorter ones are joined with their neighbours."""
    changes = np.flatnonzero(np.diff(seen)) + 1
    marks = [0, *changes.tolist(), len(seen)]
    runs = list(itertools.pairwise(marks))
    while len(runs) > 1:
        lengths = [high - low for low, high in runs]
        if min(lengths) >= least:
            break
        shortest = lengths.index(min(lengths))
        first = max(shortest - 1, 0)
        last = min(shortest + 1, len(runs) - 1)
        joined = (runs[first][0], runs[last][1])
        runs[first : last + 1] = [joined]
    return runs


def piece_between(piece: WallPiece, low: float, high: float) -> WallPiece:
    """The piece of a wall between two shares of its length."""
    along = piece.end - piece.start
    return replace(
        piece,
        start=piece.start + low * along,
        end=piece.start + high * along,
        before=piece.before if low == 0.0 else 0.0,
        after=piece.after if high == 1.0 else 0.0,
    )
