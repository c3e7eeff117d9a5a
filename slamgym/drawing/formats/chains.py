"""Chains of dimensions along walls with doors: from corner to jamb, across the door, from jamb to corner."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import shapely

from slamgym.cad.floorplan import polygon_edges
from slamgym.core.types import FloatArray
from slamgym.drawing.drawing import Drawing, DrawnDoor, DrawnPoint, DrawnRoom
from slamgym.drawing.settings import SAME_DIRECTION, THICKEST_WALL, USUAL_CELL

CHAIN_OFFSET = 0.4
"""A chain lies so far before its wall, in the room [m]."""


class Chain(NamedTuple):
    """Dimensions in a row along the face of a wall."""

    marks: list[DrawnPoint]
    """Places on the face between which is measured, one after the other; three or more [m]."""
    aside: float
    """How far to the left of the way from the first to the last the dimension lines lie [m]."""


def dimension_chains(drawing: Drawing) -> Iterator[Chain]:
    """A chain for each wall with doors, in the largest of the rooms that its doors join."""
    done = set[int]()
    for room in sorted(drawing.rooms, key=lambda room: -room.area):
        faces = polygon_edges(room.polygon)
        own = [k for k, door in enumerate(drawing.doors) if room.id in door.rooms]
        for number in own:
            if number not in done:
                wall = _Wall(drawing.doors[number], room)
                chain, along = wall.chain(faces, [(k, drawing.doors[k]) for k in own])
                done.update(along)
                if len(chain.marks) > 2:
                    yield chain


class _Wall:
    """The frame of a door's wall: x along it, y to the left."""

    def __init__(self, door: DrawnDoor, room: DrawnRoom) -> None:
        self._origin = np.array(door.start)
        x, y = (np.array(door.end) - self._origin) / door.width
        self._axes = np.array([[x, y], [-y, x]])
        middle = self._origin + 0.5 * door.width * self._axes[0]
        is_left = room.polygon.distance(shapely.Point(middle + 0.1 * self._axes[1])) < 1e-6
        self._inside = 1.0 if is_left else -1.0
        self._width = door.width

    def _local(self, points: FloatArray) -> FloatArray:
        return (points - self._origin) @ self._axes.T

    def chain(
        self, faces: FloatArray, doors: list[tuple[int, DrawnDoor]]
    ) -> tuple[Chain, list[int]]:
        """The chain along this wall, and the numbers of the doors in it.

        Args:
            faces: Of the room, (F, 2, 2) [m].
            doors: Of the room, with their numbers.
        """
        local = self._local(faces)
        x, y = local[..., 0], local[..., 1]
        is_along = np.abs(np.diff(y)[:, 0]) <= np.tan(SAME_DIRECTION) * np.abs(np.diff(x)[:, 0])
        depth = self._inside * y.mean(axis=1)
        is_face = is_along & (depth > -USUAL_CELL) & (depth <= THICKEST_WALL)
        spans = [(low, high, -1) for low, high in np.sort(x[is_face]).tolist()]
        for number, door in doors:
            ends = self._local(np.array([door.start, door.end]))
            # A door lies on either face of its wall.
            is_in_wall = np.abs(ends[:, 1]).max() <= THICKEST_WALL
            if is_in_wall and np.ptp(ends[:, 1]) < USUAL_CELL:
                low, high = np.sort(ends[:, 0]).tolist()
                spans.append((low, high, number))
        low, high = 0.0, self._width
        joined = set[tuple[float, float, int]]()
        while True:
            near = {
                span
                for span in spans
                if span[0] <= high + USUAL_CELL and span[1] >= low - USUAL_CELL
            }
            if near == joined:
                break
            joined = near
            low = min(low, *(span[0] for span in near))
            high = max(high, *(span[1] for span in near))
        along = sorted(span for span in joined if span[2] >= 0)
        marks = [low, *(place for span in along for place in span[:2]), high]
        kept = [marks[0]]
        for place in sorted(marks)[1:]:
            if place - kept[-1] > USUAL_CELL:
                kept.append(place)
        face = float(np.median(y[is_face])) if is_face.any() else 0.0
        places = self._origin + np.column_stack([kept, np.full(len(kept), face)]) @ self._axes
        chain = Chain([(px, py) for px, py in places.tolist()], self._inside * CHAIN_OFFSET)
        return chain, [span[2] for span in along]
