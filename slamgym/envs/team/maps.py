"""What the robots of a team know of each other: maps that they were told, and where these lie on their own."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from slamgym.core.errors import SlamgymError
from slamgym.core.geometry import compose, inverse, paste
from slamgym.core.types import UNKNOWN, BoolArray, ByteArray, GridFrame, OccupancyGrid, Pose2D
from slamgym.metrics.trajectory import align_se2
from slamgym.slam import Mapper
from slamgym.slam.graph.map_graph import MapGraph
from slamgym.slam.hit_counts import cropped_to_known, rendered
from slamgym.slam.merge.drawing import Picture, paint
from slamgym.slam.merge.floor import draw_submaps
from slamgym.slam.merge.joint import Joint, join
from slamgym.slam.merge.merging import Part, compare_parts
from slamgym.slam.merge.verdict import UNKNOWN_BUILDINGS

ALIGN_INTERVAL = 60.0
"""Where a map lies is measured again after so long [s]. Two drives of 40 m are joined in 0.15 CPU s where it is known
about, and searched for in 0.4 s: a minute of exploring by two robots takes some 5 CPU s."""
LEAST_WAY = 2.0
"""A path that reaches less far doesn't say how its map is turned [m]."""


class Report(NamedTuple):
    """What a robot tells of itself."""

    time: float  # when it was [s]
    grid: OccupancyGrid  # its map, in its own frame
    pose: Pose2D  # where it believes to be there


class SharedMap:
    """A robot's own map, and where that shows nothing what it was told; read as a mapper's map is.

    Args:
        mapper: The robot's own.

    Attributes:
        told: What others have mapped, on the lattice of the own map; None before it was told anything.
    """

    def __init__(self, mapper: Mapper) -> None:
        self._mapper = mapper
        self.told: OccupancyGrid | None = None

    def lattice(self) -> tuple[ByteArray, tuple[int, int]]:
        """See :meth:`slamgym.slam.Mapper.lattice`."""
        own, (row, col) = self._mapper.lattice()
        if self.told is None:
            return own, (row, col)
        frame = self.told.frame
        told_row = round(frame.origin_y / frame.resolution)
        told_col = round(frame.origin_x / frame.resolution)
        first_row, first_col = min(row, told_row), min(col, told_col)
        height = max(row + own.shape[0], told_row + frame.height_px) - first_row
        width = max(col + own.shape[1], told_col + frame.width_px) - first_col
        cells = np.full((height, width), UNKNOWN, np.uint8)
        paste(cells, self.told.cells[::-1], first_row - told_row, first_col - told_col)
        bottom, left = row - first_row, col - first_col
        under = cells[bottom : bottom + own.shape[0], left : left + own.shape[1]]
        np.copyto(under, own, where=own != UNKNOWN)
        return cells, (first_row, first_col)

    def occupancy_grid(self) -> OccupancyGrid:
        """See :meth:`slamgym.slam.Mapper.occupancy_grid`."""
        own = self._mapper.occupancy_grid()
        if self.told is None:
            return own
        return cropped_to_known(*self.lattice(), own.frame.resolution)

    def render(self, frame: GridFrame) -> ByteArray:
        """See :meth:`slamgym.slam.Mapper.render`."""
        if self.told is None:
            return self._mapper.render(frame)
        return rendered(*self.lattice(), self.told.frame.resolution, frame)


class TeamMaps:
    """The maps that the robots of one building exchange.

    Args:
        mappers: Of each robot, which have begun.
        places: Where each was put down, if they know that of each other: the origin of its map in a common frame.
    """

    def __init__(self, mappers: Sequence[Mapper], places: Sequence[Pose2D] | None) -> None:
        count = len(mappers)
        self._mappers = mappers
        self.shared = [SharedMap(mapper) for mapper in mappers]
        self._told: list[dict[int, Report]] = [{} for _ in mappers]
        self._places: list[dict[int, Pose2D]] = [{} for _ in mappers]
        self._aligned_at: dict[tuple[int, int], float] = {}
        self.is_heard: BoolArray = np.zeros((count, count), dtype=np.bool_)
        for one in range(count) if places else ():
            for other in range(count):
                if places and one != other:
                    self._places[one][other] = compose(inverse(places[one]), places[other])

    def place(self, one: int, other: int) -> Pose2D | None:
        """Where the map frame of another robot lies in that of one; None if that isn't known."""
        return self._places[one].get(other)

    def mates(self, one: int) -> Mapping[int, Pose2D]:
        """Where those robots are that one hears now, in its map frame."""
        return {
            other: compose(self._places[one][other], report.pose)
            for other, report in self._told[one].items()
            if self.is_heard[one, other] and other in self._places[one]
        }

    def exchange(self, links: BoolArray, poses: Sequence[Pose2D], time: float) -> None:
        """Let robots tell each other what they know.

        Args:
            links: Who hears whom, shape (N, N), symmetric; what one has heard it passes on at once.
            poses: Where each believes to be, in its map frame.
            time: Now [s].
        """
        self.is_heard = _reached(links)
        own = [
            Report(time, mapper.occupancy_grid(), pose)
            for mapper, pose in zip(self._mappers, poses, strict=True)
        ]
        before = [dict(told) for told in self._told]
        for one, told in enumerate(self._told):
            for other in np.flatnonzero(self.is_heard[one]).tolist():
                for about, report in {**before[other], other: own[other]}.items():
                    known = told.get(about)
                    if about != one and (known is None or report.time > known.time):
                        told[about] = report
        self._align(time)
        for one, told in enumerate(self._told):
            self._lay(one, told)

    def _align(self, time: float) -> None:
        """Find where the maps lie on each other whose robots hear each other."""
        for one, other in np.argwhere(np.triu(self.is_heard, 1)).tolist():
            last = self._aligned_at.get((one, other), 0.0)
            if time - last >= ALIGN_INTERVAL:
                self._aligned_at[one, other] = time
                graphs = [self._mappers[index].graph() for index in (one, other)]
                if graphs[0] is not None and graphs[1] is not None:
                    place = placed(graphs[0], graphs[1], self.place(one, other))
                    self._note(one, other, place)
        for one, other in np.argwhere(self.is_heard).tolist():
            for about, place in list(self._places[other].items()):
                if about not in self._places[one] and about != one and other in self._places[one]:
                    self._places[one][about] = compose(self._places[one][other], place)

    def _note(self, one: int, other: int, place: Pose2D | None) -> None:
        if place is not None:
            self._places[one][other] = place
            self._places[other][one] = inverse(place)

    def _lay(self, one: int, told: Mapping[int, Report]) -> None:
        """Lay what one robot was told on the lattice of its map."""
        places = self._places[one]
        pictures = [
            Picture(report.grid, np.array(places[about]))
            for about, report in sorted(told.items(), key=lambda item: -item[1].time)
            if about in places
        ]
        if pictures:
            lattice = self._mappers[one].occupancy_grid().frame
            self.shared[one].told = paint(pictures, lattice)


def _reached(links: BoolArray) -> BoolArray:
    """Who hears whom, directly or by way of others, shape (N, N); nobody hears itself."""
    reached = links | np.eye(len(links), dtype=np.bool_)
    for via in range(len(links)):
        reached |= reached[:, via : via + 1] & reached[via : via + 1]
    return reached & ~np.eye(len(links), dtype=np.bool_)


def placed(first: MapGraph, second: MapGraph, guess: Pose2D | None) -> Pose2D | None:
    """Where the frame of the second graph lies in that of the first; None if that isn't sure.

    Args:
        first: One.
        second: The other.
        guess: Where it lies about; None if that isn't known.
    """
    if guess is None:
        try:
            parts = [Part.of_graph("a robot's map", graph) for graph in (first, second)]
        except SlamgymError:  # nothing is mapped yet
            return None
        return compare_parts(parts[0], parts[1], UNKNOWN_BUILDINGS).place
    joint = joined_about(first, second, guess)
    if joint is None:
        return None
    points = second.poses[:, :2]
    if np.ptp(points, axis=0).max() < LEAST_WAY:
        return None
    _, moved = joint.parts(first, second)
    return align_se2(points, moved.poses[:, :2])


def joined_about(first: MapGraph, second: MapGraph, guess: Pose2D) -> Joint | None:
    """Two graphs as one, the second about where it is said to lie; None if they show nothing in common there."""
    submaps = draw_submaps(first), draw_submaps(second)
    return join(first, second, submaps, np.array(guess))
