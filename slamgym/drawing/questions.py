"""Which boundaries between rooms a person is asked about: those whose odds are nearest to even.

An answer is a correction, ``add_door``, ``split`` or ``no_door`` (:mod:`slamgym.drawing.edits`), so it is checked, kept
and carried out like all others.
"""

from collections.abc import Sequence

from shapely import MultiPolygon, Polygon

from slamgym.drawing.drawing import Question
from slamgym.drawing.edits import Correction
from slamgym.drawing.openings import DOUBTFUL, Division, Gap, cut_floor, joined_rooms
from slamgym.drawing.revise import SAME_DOOR
from slamgym.drawing.settings import SMALLEST_ROOM

MOST_ASKED = 5
"""Questions about one drawing."""
BOUNDARY_KINDS = ("split", "join", "add_door", "no_door")
"""Corrections that say where boundaries are or aren't."""


def doubtful_boundaries(
    division: Division, others: Sequence[Gap], corrections: Sequence[Correction]
) -> tuple[Question, ...]:
    """What to ask about a drawing, the most doubtful first.

    Args:
        division: Its rooms and the boundaries between them.
        others: Lines that may be boundaries and aren't drawn.
        corrections: A person's; nobody is asked twice.
    """
    asked = [entry.shape for entry in corrections if entry.kind in BOUNDARY_KINDS]
    found: list[Question] = []
    all_gaps = [(gap, True) for gap in division.doors] + [(gap, False) for gap in others]
    doubtful = [pair for pair in all_gaps if abs(pair[0].log_odds) <= DOUBTFUL]
    for gap, is_drawn in sorted(doubtful, key=lambda pair: abs(pair[0].log_odds)):
        middle = gap.line.centroid
        is_known = any(shape.distance(middle) <= SAME_DOOR for shape in asked)
        if not is_known and (is_drawn or _parts_a_room(gap, division.rooms)):
            found.append(Question(gap.start, gap.end, gap.log_odds, is_drawn))
            asked.append(gap.line)
        if len(found) == MOST_ASKED:
            break
    return tuple(found)


def _parts_a_room(gap: Gap, rooms: Sequence[Polygon]) -> bool:
    """True if a boundary alone makes two rooms of one."""
    middle = gap.line.centroid
    for room in rooms:
        if room.contains(middle):
            parts = cut_floor(MultiPolygon([room]), [gap])
            one, other = joined_rooms(parts, [gap])[0].tolist()
            is_between = min(one, other) >= 0 and one != other
            return is_between and min(parts[one].area, parts[other].area) >= SMALLEST_ROOM
    return False
