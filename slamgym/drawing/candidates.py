"""A map with the lines that may part its rooms: from it and the lines' odds follow the floor and its doors."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from shapely import MultiPolygon

from slamgym.core.types import OCCUPIED, BoolArray, FloatArray, OccupancyGrid
from slamgym.drawing.boundaries import BoundaryModels, candidate_lines
from slamgym.drawing.evidence import filled_patch
from slamgym.drawing.floor import FloorModel, floor_of_rooms, seen_floor
from slamgym.drawing.free_space import FreeSpace
from slamgym.drawing.openings import Division, Gap, divide, likely_gaps, onto_faces
from slamgym.drawing.polygons import straightened
from slamgym.drawing.signs import Signs, Surroundings, boundary_signs, door_signs
from slamgym.metrics.layers import MapLayers


class LikelyFloor(NamedTuple):
    """A floor with straight edges, and lines across it from face to face."""

    floor: MultiPolygon
    gaps: list[Gap]
    """The likely boundaries of its rooms."""
    others: list[Gap]
    """Lines that may be some, too, and were not chosen."""


@dataclass(frozen=True)
class Candidates:
    """What is known of a map before its rooms are chosen."""

    grid: OccupancyGrid
    angle_deg: float
    """Direction of the main walls."""
    layers: MapLayers
    """What the model says."""
    seen: BoolArray
    """Free space that was seen."""
    space: MultiPolygon
    """The same with straight edges [m]."""
    lines: FloatArray
    """Lines across it, (N, 2, 2) [m]."""
    signs: Signs
    """What lies around them."""

    @staticmethod
    def of(grid: OccupancyGrid, model: FloorModel, angle_deg: float) -> "Candidates":
        """Find them in a map whose main walls have a direction."""
        layers = model(grid, angle_deg)
        seen, space = seen_floor(grid, angle_deg)
        lines = np.zeros((0, 2, 2))
        if not space.is_empty:
            lines = candidate_lines(FreeSpace(space))
        signs = {}
        if len(lines):
            signs = boundary_signs(lines, Surroundings.of(grid, seen, angle_deg))
        if len(lines) and layers.has_doors:
            signs |= door_signs(lines, layers, grid.frame)
        return Candidates(grid, angle_deg, layers, seen, space, lines, signs)

    def log_odds(self, models: BoundaryModels) -> FloatArray:
        """Log odds of the lines being boundaries, (N,); with the model's doors if it looked for some."""
        if not len(self.lines):
            return np.zeros(0)
        model = models.with_doors if self.layers.has_doors else models.without_doors
        return model.log_odds(self.signs)

    def division(self, odds: FloatArray) -> Division:
        """The seen space cut into rooms by the lines with these log odds, (N,)."""
        return divide(self.space, likely_gaps(self.lines, odds))

    def floor(self, odds: FloatArray) -> "LikelyFloor":
        """The floor with straight edges, and the boundaries of rooms that are likely, from face to face."""
        if self.space.is_empty:
            return LikelyFloor(self.space, [], [])
        frame = self.grid.frame
        gaps = likely_gaps(self.lines, odds)
        division = divide(self.space, gaps)
        rooms = np.zeros(frame.shape, np.int64)
        for number, room in enumerate(division.rooms, 1):
            patch = filled_patch(room, frame)
            rooms[patch.place][patch.inside] = number
        echoes = self.grid.cells == OCCUPIED
        picture = floor_of_rooms(self.layers.free, self.seen, echoes, rooms, frame.resolution)
        floor = straightened(picture, frame, self.angle_deg)
        if floor.is_empty:
            return LikelyFloor(floor, [], [])
        drawn = set(division.doors)
        others = [gap for gap in gaps if gap not in drawn]
        return LikelyFloor(floor, onto_faces(division.doors, floor), onto_faces(others, floor))
