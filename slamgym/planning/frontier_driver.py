"""Offers frontiers to choose from, drives to the chosen one, and says when the next choice is due.

The decision process that policies learn on and that a trained policy acts in: both go through this class, so
what was learned is what is executed. Main path of a control step: :meth:`FrontierDriver.observe` takes over
the map and the clock; while it says that a choice is due, :meth:`FrontierDriver.choose` is given one of the
:attr:`FrontierDriver.candidates`; :meth:`FrontierDriver.command` drives.
"""

import math
from collections.abc import Mapping
from dataclasses import field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamgym.core.config import Count, Positive, Settings
from slamgym.core.types import ByteArray, OccupancyGrid, Pose2D, Twist2D
from slamgym.planning.context import ExplorerContext
from slamgym.planning.costmap import NO_INFORMATION
from slamgym.planning.frontier_candidates import Candidate, RoadMap, make_candidates
from slamgym.planning.frontiers import Point
from slamgym.planning.navigator import Goal, GoalStatus, Navigator, NavigatorConfig
from slamgym.planning.recovery import LastResorts, Resort

_STOP = Twist2D(0.0, 0.0)
_GROWTH = 0.5  # less than this is no growth of the map [m2]: noise opens pinholes for ever


class DriverConfig(Settings):
    """How frontiers are offered and driven to."""

    max_candidates: Count = 16
    """K: so many frontiers are offered at most, those with the shortest paths."""
    horizon: Positive = 6.0
    """A choice is reconsidered after so long, even if its frontier is still there [s]."""
    min_frontier_size: Positive = 0.5
    """Frontiers shorter than this are left for the end [m]."""
    split_extent: Positive = 3.0
    """A frontier that reaches farther than this is offered in parts [m]."""
    blacklist_distance: float = 0.25
    """A frontier is blacklisted if both coordinates of its centroid are this near to an entry [m]."""
    progress_timeout: Positive = 30.0
    """A frontier that the robot doesn't come nearer to for so long is given up [s]."""
    stall_time: Positive = 40.0
    """If the map hasn't grown for so long, choices are no longer reconsidered on the way: a policy that
    changes its mind for ever would never arrive [s]."""
    last_frontier_size: float = 0.25
    """Once nothing larger is left, frontiers down to this size are offered too [m]."""
    last_radius_shares: tuple[float, ...] = (0.85, 0.6)
    """Then also doors that a robot of these shares of the radius could pass: maps draw walls too thick."""
    look_around_before: float = 30.0
    """If nothing is left to explore so soon, the robot first turns once round on the spot [s]."""
    closed_room_looks: int = 8
    """Rooms that the map cuts off from the robot are looked at from so many places at most."""
    futile_goals: int = 12
    """So many frontiers in a row that added nothing to the map end the exploration."""
    navigator: NavigatorConfig = field(default_factory=NavigatorConfig)
    """Navigation stack."""


class FrontierDriver:
    """One robot's exploration by chosen frontiers.

    Args:
        context: What the environment tells about the robot and its map.
        config: Settings.

    Attributes:
        candidates: What may be chosen now, the shortest path first; at most ``config.max_candidates``.
        num_frontiers: How many frontiers there were before the list was cut.
        finished: Nothing that the robot can reach is left to explore.
        target: The frontier that the robot drives to, None if there is none.
        pose: The newest believed pose.
        time: The newest time [s].
        known_area: Area of the map's known cells [m2].
    """

    def __init__(self, context: ExplorerContext, config: DriverConfig | None = None) -> None:
        self.context = context
        self.config = config or DriverConfig()
        self.navigator = Navigator(context, self.config.navigator)
        self.candidates: list[Candidate] = []
        self.roads: RoadMap | None = None
        self.num_frontiers = 0
        self.finished = False
        self.target: Candidate | None = None
        self.pose = Pose2D(0.0, 0.0, 0.0)
        self.time = 0.0
        self.known_area = 0.0
        self._scan: NDArray[np.float32] = np.zeros(0, np.float32)
        self._map: ByteArray | None = None
        self._is_new_map = False  # since the last search of candidates
        self._is_stale = True  # something but the map has changed since then
        self._chosen_at = -math.inf
        self._is_due = True
        self._blacklist: list[Point] = []
        self._progress_from: Point = (math.inf, math.inf)
        self._progress_distance, self._progress_at = math.inf, 0.0
        self._grown_to, self._grown_at, self._futile = 0.0, 0.0, 0
        self._judge_at = -math.inf
        self._last_resorts = LastResorts(
            context,
            self.navigator,
            self.config.look_around_before,
            self.config.last_radius_shares,
            self.config.closed_room_looks,
        )

    @property
    def round(self) -> int:
        """0 at first; counts the gentler rules tried at the end."""
        return self._last_resorts.round

    # The three steps of the protocol.

    def observe(self, observation: Mapping[str, NDArray[Any]]) -> bool:
        """Take over an observation; whether a choice is due.

        Args:
            observation: Of an environment whose map is the global one: ``"map"`` uint8 (1, H, W), ``"scan"``
                (num_beams,) [m], ``"pose"`` (3,) in the map frame, ``"time"`` (1,) [s].
        """
        self.pose = Pose2D(*(float(value) for value in observation["pose"]))
        self.time = float(observation["time"][0])
        self._scan = observation["scan"]
        self._last_resorts.note_time(self.time)
        self._take_map(observation["map"])
        self._mind_result()
        if self._last_resorts.is_turning or self.finished:
            return False
        if self._wants_choice():
            self._offer()
        return bool(self.candidates) and self._is_due

    def choose(self, index: int) -> bool:
        """Drive to a candidate.

        Args:
            index: Of :attr:`candidates`.

        Returns:
            Whether a path leads there. Otherwise the candidate is taken off the list, and as long as others
            are left a choice is still due.

        Raises:
            IndexError: If there is no such candidate.
        """
        candidate = self.candidates[index]
        same = self.target is not None and math.dist(self.target.target, candidate.target) < 0.01
        if not (same and self.navigator.is_active) and not self._set_goal(candidate):
            self._blacklist.append(candidate.frontier.centroid)
            del self.candidates[index]
            self.target = None
            self.navigator.cancel()
            self._is_stale = not self.candidates
            return False
        self.target = candidate
        self._chosen_at = self.time
        self._is_due = False
        return True

    def command(self) -> Twist2D:
        """Velocity for the next control step."""
        if self._last_resorts.is_turning:
            return self._last_resorts.turn(self.pose)
        if self.finished:
            return _STOP
        command = self.navigator.step(self.pose, self._scan, self.time)
        if self.target is None and self.navigator.status is GoalStatus.SUCCEEDED:
            # The robot looks at a closed room: what the scan sees through is no wall.
            self.navigator.trust_scan(self.pose, self._scan, self.time)
            self.navigator.cancel()
            self._is_stale = True
        return command

    # The parts of observe.

    def _take_map(self, cells: ByteArray) -> None:
        """Hand a newly published map to the navigation stack."""
        # The environment publishes a new read-only array for a new map; any other array may have been
        # written to in place, so it is compared.
        if cells is self._map and not cells.flags.writeable:
            return
        unchanged = cells.flags.writeable and self._map is not None and np.array_equal(cells, self._map)
        self._map = cells.copy() if cells.flags.writeable else cells
        if unchanged:
            return
        grid = OccupancyGrid(cells.reshape(self.context.frame.shape), self.context.frame)
        self.navigator.update_map(grid, self.pose, self.time)
        self._is_new_map = True
        costmap = self.navigator.costmap
        if costmap is not None:
            cell_area = self.context.frame.resolution**2
            self.known_area = float(np.count_nonzero(costmap.costs != NO_INFORMATION)) * cell_area
        if self.known_area > self._grown_to + _GROWTH:
            self._grown_to, self._grown_at = self.known_area, self.time

    def _mind_result(self) -> None:
        """Blacklist a frontier whose goal ended.

        One that was reached is blacklisted too: if it is gone that does no harm, and if it is still there then
        going there again would not help.
        """
        status = self.navigator.status
        if self.target is None or status not in (GoalStatus.SUCCEEDED, GoalStatus.ABORTED):
            return
        self._futile = 0 if self._grown_at >= self._chosen_at else self._futile + 1
        self._drop_target()
        self._judge_at = self.time + self.context.map_update_interval + self.context.control_step

    def _wants_choice(self) -> bool:
        """Whether the candidates have to be searched anew."""
        if self.target is None:
            changed = self._is_stale or self._is_new_map or self.time >= self._judge_at
            return changed and not self.navigator.is_active
        if not self._is_new_map:
            return False
        if not self._is_making_progress():
            self._drop_target()
            return True
        if not self._is_still_there(self.target):
            return True
        is_stalled = self.time - self._grown_at > self.config.stall_time
        return not is_stalled and self.time - self._chosen_at >= self.config.horizon - 1e-6

    def _offer(self) -> None:
        """Search the candidates; without any, try what is left to try."""
        self._is_new_map = self._is_stale = False
        self._is_due = True
        self.candidates, self.num_frontiers = [], 0
        costmap, space = self.navigator.costmap, self.navigator.reachable
        if costmap is not None and space is not None and self._futile < self.config.futile_goals:
            size = self.config.min_frontier_size
            if self.round:
                size = min(size, self.config.last_frontier_size)
            found, self.roads = make_candidates(
                costmap,
                space,
                self.pose,
                min_size=size,
                split_extent=self.config.split_extent,
                tolerance=self.config.navigator.plan_tolerance,
                keep=self.target.target if self.target else None,
            )
            found = [one for one in found if not self._is_blacklisted(one.frontier.centroid)]
            self.num_frontiers = len(found)
            self.candidates = found[: self.config.max_candidates]
        if not self.candidates:
            self.target = None
            self.navigator.cancel()
            self._nothing_left()

    def _drop_target(self) -> None:
        assert self.target is not None
        self._blacklist.append(self.target.frontier.centroid)
        self.target = None
        self.navigator.cancel()
        self._is_stale = True

    def _set_goal(self, candidate: Candidate) -> bool:
        """Send a goal to the navigation stack; False if it can't be reached."""
        frontier = candidate.frontier
        for target in dict.fromkeys((candidate.target, frontier.middle, frontier.nearest)):
            self.navigator.set_goal(Goal(*target, look_at=frontier.middle), self.pose, self.time)
            if self.navigator.is_active:
                return True
        return False

    def _is_making_progress(self) -> bool:
        """Whether the goal is new or the robot has come nearer to it within the time-out."""
        assert self.target is not None
        target = self.target.target
        distance = math.dist(target, self.pose[:2])
        # A goal that only jitters with the map is not a new one.
        if math.dist(target, self._progress_from) > 0.5 or distance < self._progress_distance - 0.05:
            self._progress_from, self._progress_distance, self._progress_at = target, distance, self.time
        return self.time - self._progress_at <= self.config.progress_timeout

    def _is_still_there(self, candidate: Candidate) -> bool:
        """Whether enough cells of a frontier are still unknown on the newest map."""
        costmap = self.navigator.costmap
        assert costmap is not None
        row, col = costmap.frame.to_cell(candidate.points[:, 0], candidate.points[:, 1])
        height, width = costmap.costs.shape
        inside = (row >= 0) & (row < height) & (col >= 0) & (col < width)
        unknown = costmap.costs[row[inside], col[inside]] == NO_INFORMATION
        left = int(np.count_nonzero(unknown)) + int(np.count_nonzero(~inside))
        return left >= 0.5 * len(candidate.points)

    def _is_blacklisted(self, point: Point) -> bool:
        within = self.config.blacklist_distance + 0.5 * self.context.frame.resolution
        return any(abs(point[0] - x) < within and abs(point[1] - y) < within for x, y in self._blacklist)

    # The end.

    def _nothing_left(self) -> None:
        """Begin what is to be tried before the end, or end."""
        if self.navigator.is_active or self.time < self._judge_at:
            return  # on the way to a closed room, or the map doesn't show yet what the last goal brought
        self._futile = 0
        self._is_stale = True
        resort = self._last_resorts.attempt(self.pose, self.time)
        if resort is Resort.GENTLER_RULES and self.round == 1:
            # What was given up may have become possible: people walk on and maps get better.
            self._blacklist.clear()
        self.finished = resort is Resort.NOTHING
