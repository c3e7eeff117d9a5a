"""Maps of several mappers in one frame, without ROS: where each lies, and the map of them all.

Only pictures come over topics, so a picture is laid on what has been gathered so far. One is used once it is sure
where it lies; where its robot was put down is known, that is the first guess, and only aligned. What was heard once
stays: a robot that has died takes nothing along.
"""

from collections.abc import Mapping

import numpy as np

from slamgym.core.errors import SlamgymError
from slamgym.core.geometry import between, compose, inverse, wrap_angle
from slamgym.core.types import UNKNOWN, GridFrame, OccupancyGrid, Pose2D
from slamgym.ros2.foreign_maps import LATTICE_CELL
from slamgym.slam.merge.drawing import Picture, paint
from slamgym.slam.merge.merging import Part, compare_parts
from slamgym.slam.merge.overlay import FINE, agreement
from slamgym.slam.merge.verdict import UNKNOWN_BUILDINGS

GROWTH = 1.1
"""A map is searched for again once it has grown by this factor."""
FARTHEST_ALIGNED = (0.6, 0.15)
"""An alignment that moves a map further isn't one [m], [rad]: people measure starts by a tape and by eye."""
AT_ORIGIN = Pose2D(0.0, 0.0, 0.0)


class GatheredMaps:
    """Maps by the names of their robots.

    Args:
        places: Where maps lie whose robots' starts are known; the first map that comes gives the frame if none is.

    Attributes:
        maps: The newest of each robot.
        places: Of those that are placed, each in the common frame.
    """

    def __init__(self, places: Mapping[str, Pose2D]) -> None:
        self.maps: dict[str, OccupancyGrid] = {}
        self.places = dict(places)
        self._tried: dict[str, int] = {}  # known cells when a map was searched for last

    def take(self, name: str, grid: OccupancyGrid) -> None:
        """Take over a robot's newest map."""
        self.maps[name] = grid
        if not self.places:
            self.places[name] = AT_ORIGIN

    def improve(self) -> str:
        """Place a map that isn't placed yet, or align one that is, by turns; says what is new, if anything is."""
        for name, grid in self.maps.items():
            known = int(np.count_nonzero(grid.cells != UNKNOWN))
            if known < GROWTH * self._tried.get(name, 0) or known == 0:
                continue
            others = self.merged(without=name)
            if others is None or not (others.cells != UNKNOWN).any():
                continue
            self._tried[name] = known
            was_placed = name in self.places
            place = find_place(others, name, grid, self.places.get(name))
            if place is not None:
                self.places[name] = place
                if not was_placed:
                    return f"{name} is on the map, at {place.x:.2f}, {place.y:.2f} m, {place.theta:.2f} rad"
            return ""
        return ""

    def merged(self, without: str = "") -> OccupancyGrid | None:
        """The map of all that are placed; None if there is none."""
        pictures = [
            Picture(grid, np.array(self.places[name]))
            for name, grid in self.maps.items()
            if name in self.places and name != without
        ]
        lattice = GridFrame(LATTICE_CELL, 0.0, 0.0, 1, 1)
        return paint(pictures, lattice) if pictures else None

    def seen_from(self, name: str, merged: OccupancyGrid) -> OccupancyGrid | None:
        """The map of all in the frame of one robot's; None if that one isn't placed."""
        if name not in self.places:
            return None
        place = np.array(inverse(self.places[name]))
        return paint([Picture(merged, place)], GridFrame(LATTICE_CELL, 0.0, 0.0, 1, 1))

    def mates(self, name: str, poses: Mapping[str, Pose2D]) -> list[Pose2D]:
        """Where other robots are in the frame of one robot's map.

        Args:
            name: That one.
            poses: Of robots, each on its own map.
        """
        if name not in self.places:
            return []
        own = self.places[name]
        return [
            between(own, compose(self.places[other], pose))
            for other, pose in poses.items()
            if other != name and other in self.places
        ]


def find_place(
    others: OccupancyGrid, name: str, grid: OccupancyGrid, guess: Pose2D | None
) -> Pose2D | None:
    """Where a map lies on others; None if that isn't sure.

    Args:
        others: What has been gathered.
        name: Of the map, for errors.
        grid: The map.
        guess: Where it lies about; None if that isn't known.
    """
    try:
        first = Part.of_picture("the other maps", others)
        second = Part.of_picture(name, grid)
    except SlamgymError:  # one shows no wall yet
        return None
    if guess is None:
        return compare_parts(first, second, UNKNOWN_BUILDINGS).place
    pose, _ = first.fields.align(second.floor.surfaces, np.array(guess))
    place = Pose2D(*pose.tolist())
    moved = between(guess, place)
    said = agreement(first.fields, second.fields, pose, FINE)
    is_near = max(abs(moved.x), abs(moved.y)) < FARTHEST_ALIGNED[0]
    is_turned = abs(wrap_angle(moved.theta)) > FARTHEST_ALIGNED[1]
    is_sure = UNKNOWN_BUILDINGS.evidence(said) >= UNKNOWN_BUILDINGS.sure
    return place if is_sure and is_near and not is_turned else None


def laid_under(own: OccupancyGrid, others: OccupancyGrid | None) -> OccupancyGrid:
    """A map, and where it shows nothing what others show, both in one frame and on one lattice."""
    if others is None:
        return own
    at_place = np.zeros(3)
    laid = paint([Picture(own, at_place), Picture(others, at_place)], own.frame)
    laid.cells.flags.writeable = False  # a new map is a new array
    return laid
