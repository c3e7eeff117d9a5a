"""Names of rooms that the map itself gives: owners of robot vacuums type them in."""

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from slamgym.core.text import printable
from slamgym.core.types import GridFrame
from slamgym.drawing.drawing import Drawing
from slamgym.drawing.evidence import filled_patch
from slamgym.drawing.settings import MAJORITY
from slamgym.interop.valetudo import MapSegment

NOT_TYPED = re.compile(r"segment \d+|\W*\d*\W*")
"""Numbers that a robot gives to segments are no names."""


def with_given_names(drawing: Drawing, segments: Sequence[MapSegment], frame: GridFrame) -> Drawing:
    """A drawing whose rooms are called as the map calls them, where no person has named them.

    Args:
        drawing: The drawing of a map.
        segments: The map's own rooms; one that covers most of several drawn rooms names the largest of these.
        frame: Of the segments' cells.
    """
    rooms = list(drawing.rooms)
    typed = [segment for segment in segments if not NOT_TYPED.fullmatch(segment.name.strip())]
    largest_first = sorted(range(len(rooms)), key=lambda number: -rooms[number].area)
    for segment in typed:
        for number in largest_first:
            room = rooms[number]
            patch = filled_patch(room.polygon, frame)
            share = np.mean(segment.cells[patch.place][patch.inside])
            if room.name == room.id and share > MAJORITY:
                name = re.sub(r"[|`]", "", printable(segment.name)).strip()
                rooms[number] = replace(room, name=name or room.id)
                break
    return replace(drawing, rooms=tuple(rooms))
