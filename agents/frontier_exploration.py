"""What all frontier explorers share: the map, the ticks, the goal, the blacklist, and the end.

Main path of a control step: take over a newly published map; deal with a goal that ended; at a tick search
the frontiers, rank them, and send the best one to the navigation stack; let the navigation stack drive.
"""

import math
from abc import abstractmethod
from dataclasses import field
from typing import NamedTuple

import numpy as np

from slamgym.agents.explorer import Exploration, Observation
from slamgym.core.config import Settings
from slamgym.core.types import ByteArray, FloatArray, OccupancyGrid, Pose2D, Twist2D
from slamgym.planning.context import ExplorerContext
from slamgym.planning.costmap import NO_INFORMATION
from slamgym.planning.frontiers import Frontier, Point, find_frontiers
from slamgym.planning.grid_path import COST_FACTOR, path_costs, place_near
from slamgym.planning.navigator import Goal, GoalStatus, Navigator, NavigatorConfig
from slamgym.planning.recovery import LastResorts, Resort

_STOP = Twist2D(0.0, 0.0)


class ExplorationConfig(Settings):
    """What all frontier explorers share."""

    blacklist_cells: int = 5
    """A frontier is blacklisted if both coordinates of its centroid are this near to an entry [cells]."""
    bend: float = 0.5
    """A frontier whose centroid is farther than this from its nearest cell is visited at that cell [m]."""
    last_frontier_size: float = 0.6
    """Once nothing larger is left, frontiers down to this size are visited too [m]."""
    last_radius_shares: tuple[float, ...] = (0.85, 0.6)
    """Then also doors that a robot of these shares of the radius could pass: maps draw walls too thick."""
    look_around_before: float = 30.0
    """If nothing is left to explore so soon, the robot first turns once round on the spot [s]."""
    closed_room_looks: int = 8
    """Rooms that the map cuts off from the robot are looked at from so many places at most."""
    futile_goals: int = 12
    """So many goals in a row that added nothing to the map end the exploration."""
    navigator: NavigatorConfig = field(default_factory=NavigatorConfig)
    """Navigation stack."""


class Candidate(NamedTuple):
    """A frontier that may be chosen, and where the robot would go for it."""

    frontier: Frontier
    target: Point  # [m]


class FrontierExploration(Exploration):
    """One robot's frontier exploration; a subclass ranks the frontiers.

    Args:
        context: What the environment tells about the robot and its map.
        config: What all frontier explorers share.
        interval: Time between two ticks [s].
        progress_timeout: A goal that the robot doesn't come nearer to for so long is given up [s].
        min_frontier_size: Frontiers shorter than this are left for the end [m].
        keeps_goal: Whether a goal is kept for as long as its frontier exists.
    """

    def __init__(
        self,
        context: ExplorerContext,
        config: ExplorationConfig,
        interval: float,
        progress_timeout: float,
        min_frontier_size: float,
        keeps_goal: bool = False,
    ) -> None:
        self.context = context
        self.config = config
        self._interval = interval
        self._progress_timeout = progress_timeout
        self._min_frontier_size = min_frontier_size
        self._keeps_goal = keeps_goal
        self._navigator = Navigator(context, config.navigator)
        self._pose = Pose2D(0.0, 0.0, 0.0)
        self._map: ByteArray | None = None
        self._tick_at = -math.inf
        self._target: Candidate | None = None  # what the navigation stack drives to
        self._blacklist: list[Point] = []
        self._progress_from: Point = (math.inf, math.inf)  # the goal that progress is measured to
        self._progress_distance, self._progress_at = math.inf, 0.0
        self._known_cells, self._futile = 0, 0
        self._judge_at = -math.inf
        self._last_resorts = LastResorts(
            context,
            self._navigator,
            config.look_around_before,
            config.last_radius_shares,
            config.closed_room_looks,
        )

    @abstractmethod
    def _rank(self, candidates: list[Candidate]) -> list[Candidate]:
        """Order the candidates, the best first."""

    def act(self, observation: Observation) -> Twist2D:
        """Velocity for the next control step; see :meth:`Exploration.act`."""
        pose = Pose2D(*(float(value) for value in observation["pose"]))
        time = float(observation["time"][0])
        self._pose = pose
        self._last_resorts.note_time(time)
        self._take_map(observation["map"], pose, time)
        self._mind_result(time)
        if self._last_resorts.is_turning:
            return self._last_resorts.turn(pose)
        if time - self._tick_at >= self._interval - 1e-6:
            self._tick(pose, time)
        if self.finished:
            return _STOP
        command = self._navigator.step(pose, observation["scan"], time)
        if self._target is None and self._navigator.status is GoalStatus.SUCCEEDED:
            # The robot looks at a closed room: what the scan sees through is no wall.
            self._navigator.trust_scan(pose, observation["scan"], time)
            self._navigator.cancel()
            self._tick_at = -math.inf
        return command

    def _take_map(self, cells: ByteArray, pose: Pose2D, time: float) -> None:
        """Hand the map to the navigation stack if it has changed."""
        # The environment publishes a new read-only array for a new map; any other array may have been
        # written to in place, so it is compared.
        if cells is self._map and not cells.flags.writeable:
            return
        unchanged = self._map is not None and _same(cells, self._map)
        self._map = cells.copy() if cells.flags.writeable else cells
        if unchanged:
            return
        grid = OccupancyGrid(cells.reshape(self.context.frame.shape), self.context.frame)
        self._navigator.update_map(grid, pose, time)

    def _mind_result(self, time: float) -> None:
        """Close a goal that ended; any end makes the next tick come at once.

        A goal that was reached is not visited again either: if its frontier is gone that does no harm, and if it is
        still there then going there again would not help.
        """
        status = self._navigator.status
        if self._target is None or status not in (GoalStatus.SUCCEEDED, GoalStatus.ABORTED):
            return
        self._close(self._target, status is GoalStatus.SUCCEEDED)
        self._target = None
        self._navigator.cancel()
        self._tick_at = -math.inf
        self._judge_at = time + self.context.map_update_interval + self.context.control_step
        known = (
            int(np.count_nonzero(self._navigator.costmap.costs != NO_INFORMATION))
            if self._navigator.costmap
            else 0
        )
        grown = known > self._known_cells + 20
        self._futile = 0 if grown else self._futile + 1
        self._known_cells = max(known, self._known_cells)

    def _close(self, candidate: Candidate, reached: bool) -> None:  # noqa: ARG002 - for subclasses
        """Deal with a goal that ended: its frontier is not visited again."""
        self._blacklist.append(candidate.frontier.centroid)

    def _tick(self, pose: Pose2D, time: float) -> None:
        """Search the frontiers and go on to the best."""
        self._tick_at = time
        candidates = self._candidates(pose)
        if self._target is not None and not self._is_making_progress(pose, time):
            self._blacklist.append(self._target.frontier.centroid)
            candidates = [c for c in candidates if not self._is_blacklisted(c.frontier)]
            self._target = None
            self._navigator.cancel()
        if self._keeps_goal and self._target is not None and self._still_there(candidates):
            return
        self.decisions += bool(candidates)
        for candidate in self._rank(candidates) if candidates else []:
            if self._go(candidate, pose, time):
                return
        if self._target is not None:
            self._target = None
            self._navigator.cancel()
        self._nothing_left(pose, time)

    def _candidates(self, pose: Pose2D) -> list[Candidate]:
        """Frontiers that are not blacklisted, with a place to go to for each."""
        costmap, space = self._navigator.costmap, self._navigator.reachable
        if costmap is None or space is None or self._futile >= self.config.futile_goals:
            return []
        size = self.config.last_frontier_size if self._last_resorts.round else self._min_frontier_size
        frontiers = find_frontiers(costmap, pose, min(size, self._min_frontier_size), reachable=space)
        candidates = []
        for frontier in frontiers:
            if self._is_blacklisted(frontier):
                continue
            candidates.append(Candidate(frontier, self._place_to_go(frontier)))
        return candidates

    def _place_to_go(self, frontier: Frontier) -> Point:
        """Where to go for a frontier: its centroid, unless that would not bring the robot to it.

        The centroid of a frontier that bends round the robot is about where the robot stands, and one drawn
        anew would send it to and fro. So a place on the frontier is chosen then, and kept for as long as the
        frontier passes there.
        """
        if self._target is not None and self._passes_by(frontier, self._target.target):
            return self._target.target
        bends = math.dist(frontier.centroid, frontier.middle) > self.config.bend
        return frontier.middle if bends else frontier.centroid

    def _passes_by(self, frontier: Frontier, point: Point) -> bool:
        """Whether some cell of a frontier is as near to a point as the blacklist asks."""
        assert self._navigator.costmap is not None
        row, col = self._navigator.costmap.frame.to_cell(*point)
        off = np.abs(frontier.cells - np.array([row, col])).max(axis=1)
        return bool(off.min() <= self.config.blacklist_cells)

    def _go(self, candidate: Candidate, pose: Pose2D, time: float) -> bool:
        """Send a goal to the navigation stack; False if it can't be reached."""
        frontier = candidate.frontier
        same = self._target is not None and math.dist(self._target.target, candidate.target) < 0.01
        if same and self._navigator.status is GoalStatus.ACTIVE:
            return True
        for target in dict.fromkeys((candidate.target, frontier.middle, frontier.nearest)):
            self._navigator.set_goal(Goal(*target, look_at=frontier.middle), pose, time)
            if self._navigator.status is GoalStatus.ACTIVE:
                self._target = candidate
                return True
        return False

    def _is_making_progress(self, pose: Pose2D, time: float) -> bool:
        """Whether the goal is new or the robot has come nearer to it within the time-out."""
        assert self._target is not None
        target = self._target.target
        distance = self._distance_left(pose)
        # A goal that only jitters with the map is not a new one.
        if math.dist(target, self._progress_from) > 0.5 or distance < self._progress_distance - 0.05:
            self._progress_from, self._progress_distance, self._progress_at = target, distance, time
        elif distance > self._progress_distance + 0.5:
            self._progress_distance = distance  # a longer way had to be taken: progress is made along it
        return time - self._progress_at <= self._progress_timeout

    def _distance_left(self, pose: Pose2D) -> float:
        """What progress is measured by: the way that is left to the goal [m]."""
        return self._navigator.follower.remaining(pose)

    def _is_blacklisted(self, frontier: Frontier) -> bool:
        within = (self.config.blacklist_cells + 0.5) * self.context.frame.resolution
        x, y = frontier.centroid
        return any(abs(x - bx) < within and abs(y - by) < within for bx, by in self._blacklist)

    def _still_there(self, candidates: list[Candidate]) -> bool:
        """Whether some frontier still has cells where the goal's frontier was."""
        assert self._target is not None
        middle = self._target.frontier.middle
        return any(self._passes_by(candidate.frontier, middle) for candidate in candidates)

    def _path_costs(
        self, candidates: list[Candidate], factor: float = COST_FACTOR, only_nearest: bool = False
    ) -> FloatArray:
        """Cost of the path to each candidate, inf where none leads, shape (N,) [m].

        Args:
            candidates: Where to.
            factor: Weight of the costs on the way; 0 gives path lengths.
            only_nearest: All but the nearest get inf, which is much cheaper.
        """
        navigator = self._navigator
        assert navigator.costmap is not None
        assert navigator.reachable is not None
        tolerance = self.config.navigator.plan_tolerance
        places = [
            place_near(navigator.costmap, c.frontier.middle, tolerance, navigator.reachable)
            for c in candidates
        ]
        until = [place for place in places if place is not None] if only_nearest else ()
        costs = path_costs(navigator.costmap, navigator.reachable, factor, until)
        return np.array([math.inf if place is None else costs[place] for place in places])

    def _nothing_left(self, pose: Pose2D, time: float) -> None:
        """Begin what is to be tried before the end, or end."""
        if self._navigator.is_active or time < self._judge_at:
            return  # on the way to a closed room, or the map doesn't show yet what the last goal brought
        self._tick_at = -math.inf
        self._futile = 0
        resort = self._last_resorts.attempt(pose, time)
        if resort is Resort.GENTLER_RULES and self._last_resorts.round == 1:
            # What was given up may have become possible: people walk on and maps get better.
            self._blacklist.clear()
            self._progress_from = (math.inf, math.inf)
        elif resort is Resort.CLOSED_ROOM:
            self._tick_at = time
        self.finished = resort is Resort.NOTHING


def _same(a: ByteArray, b: ByteArray) -> bool:
    """Whether two maps are equal, looking at eight cells together where the width allows."""
    if a.shape[-1] % 8 == 0 and a.flags.c_contiguous and b.flags.c_contiguous:
        return bool((a.view(np.uint64) == b.view(np.uint64)).all())
    return np.array_equal(a, b)
