"""One robot's exploration on maps from outside: everything that an explorer node decides, without ROS.

The node hands maps, poses and scans over and carries out the order of each :meth:`Exploration.step`. The explorers are
those of the environments, on the same loop. What differs here: the navigation may be another's, which aborts goals for
reasons that nobody sees, and nobody ends the episode. So nothing is given up for good at once. When the loop has
ended, places that were not reached are tried again after a growing pause, and they count as unreachable only if the
robot drove elsewhere meanwhile. A robot that reaches nothing is blocked, says so, and goes on trying.
"""

import enum
import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from slamgym.agents.explorer import BatchedExplorer, FrontierPilot
from slamgym.agents.registry import make_explorer
from slamgym.core.errors import ConfigError
from slamgym.core.progress import counted
from slamgym.core.types import (
    UNKNOWN,
    Float32Array,
    FloatArray,
    GridFrame,
    LaserGeometry,
    LaserScan,
    OccupancyGrid,
    Pose2D,
    Twist2D,
)
from slamgym.planning.context import ExplorerContext
from slamgym.planning.exploration_loop import ExplorationLoop
from slamgym.planning.frontiers import Point
from slamgym.planning.navigator import STOP, Navigator
from slamgym.ros2.foreign_maps import LATTICE_CELL
from slamgym.ros2.inputs import fence, fit_ranges, knows_place, usable_scan
from slamgym.ros2.orders import DriveOrder, GoalDesk
from slamgym.ros2.parameters import ExploreParameters
from slamgym.ros2.trials import RobotClock, Trials
from slamgym.ros2.way_back import WayBack

_PATIENCE = 2.0
"""A goal that was sent is kept for so long without a pose [s]: transforms are late now and then."""
_NO_SCANNER = LaserGeometry(360, -math.pi, math.pi / 180.0, 0.12, 3.5)
"""Assumed where another navigation drives and there is no scan (TurtleBot3's)."""
_MAP_INTERVAL = 5.0
"""Time between two maps of the slowest usual mappers [s] (slam_toolbox, GMapping)."""

ALONE = np.zeros((0, 3))
"""Poses of the other robots that are heard: none."""


class ExplorationState(enum.Enum):
    """State of an exploration."""

    WAITING = "waiting"
    EXPLORING = "exploring"
    PAUSED = "paused"
    RETURNING = "returning"
    DONE = "done"
    BLOCKED = "blocked"


class ExplorationView(NamedTuple):
    """What viewers show, in the map frame [m]."""

    frontiers: tuple[FloatArray, ...]
    """Centres of the cells of each frontier that is offered, shape (N, 2)."""
    chosen: FloatArray | None
    """Those of the chosen one."""
    goal: Point | None
    path: FloatArray
    """What is left of the path, shape (N, 2)."""
    known_area: float
    """[m2]."""


class Exploration:
    """One robot's exploration.

    Use: :meth:`take_map` for each map, :meth:`step` once per :attr:`control_step`; carry out its order. Where another
    navigation drives, :meth:`goal_ended` with what became of a goal.

    Args:
        settings: What the node was told.

    Attributes:
        settings: The same.
        state: The state after the last step.
        text: The same in words: what it waits for, what is left, why it is blocked, what was not reached.
        start: Where the exploration began, map frame.

    Raises:
        ConfigError: If there is no such explorer, or it doesn't choose frontiers.
    """

    def __init__(self, settings: ExploreParameters) -> None:
        self.settings = settings
        self.state = ExplorationState.WAITING
        self.text = "waiting for a map"
        self.start: Pose2D | None = None
        self._context = ExplorerContext(
            GridFrame(LATTICE_CELL, 0.0, 0.0, 1, 1),
            _NO_SCANNER,
            settings.robot_radius,
            settings.max_linear,
            settings.max_angular,
            map_update_interval=_MAP_INTERVAL,
            normalized_actions=False,
            drives=settings.drive == "wheels",
        )
        _make_pilot(settings.explorer, self._context)
        self._grid: OccupancyGrid | None = None
        self._clock = RobotClock()
        self._complete_at = -math.inf  # by that clock, when nothing was missing last [s]
        self._desk = GoalDesk()
        self._is_paused = False
        self._begin()

    def _begin(self) -> None:
        """Begin a new exploration, on the map that there is."""
        self._pilot: FrontierPilot | None = None
        self._back: WayBack | None = None
        self._is_over = False
        self._notes: list[str] = []  # what there is to say at the end
        self._trials = Trials()

    @property
    def control_step(self) -> float:
        """Time from step to step [s]."""
        return self._context.control_step

    # What the node hands over.

    def take_map(self, grid: OccupancyGrid) -> None:
        """Take over a newly published map, on the lattice of :class:`~slamgym.ros2.foreign_maps.ForeignMap`."""
        self._grid = fence(grid, self.settings.corners)

    def goal_ended(self, number: int, reached: bool) -> None:
        """Take over what became of the goal of a number; what became of older ones is passed over."""
        self._desk.end(number, reached)

    def pause(self) -> None:
        """Stand still until :meth:`resume`; time stands still, too."""
        self._is_paused = True

    def resume(self) -> None:
        """Go on after a pause; after the end a new exploration begins."""
        if self.state is ExplorationState.DONE:
            self._begin()
        self._is_paused = False

    def return_to_start(self) -> None:
        """Drive to where the exploration began, if it has; it is paused then, if it isn't done."""
        if self._pilot is not None and self.start is not None:
            radius = self._pilot.loop.navigator.inscribed_radius
            self._back = WayBack(self._context, self.start, radius)
            self._is_paused = False
            if not self._is_over:
                self._notes = []

    def step(
        self, pose: Pose2D | None, scan: LaserScan | None, stamp: float, mates: FloatArray = ALONE
    ) -> DriveOrder:
        """Decide about the next control step.

        Args:
            pose: The robot in the map frame; None if it isn't known now.
            scan: The newest scan; None if there is none of late.
            stamp: Robot time [s].
            mates: Poses (K, 3) of the robots of its team that are heard now, in the map frame.
        """
        if self._clock.tick(stamp, self._is_paused):
            self.start = None
            self._begin()
        scan = usable_scan(scan)
        grid = self._grid
        missing = self._find_missing(pose, scan)
        if missing or pose is None or grid is None:
            return self._wait(missing)
        self._complete_at = self._clock.now
        self.start = self.start or pose
        if self._pilot is None:
            geometry = scan.geometry if scan else _NO_SCANNER
            self._context = replace(self._context, geometry=geometry)
            self._pilot = _make_pilot(self.settings.explorer, self._context)
        ranges = fit_ranges(scan, self._context.geometry)
        if self._is_paused:
            text = "; ".join(["paused", *self._notes])
            return self._stand(ExplorationState.PAUSED, text)
        if self._back is not None:
            return self._return(self._back, grid, pose, ranges)
        if self._is_over:
            return self._stand(ExplorationState.DONE, f"done: {'; '.join(self._notes)}")
        return self._explore(self._pilot, grid, pose, ranges, mates)

    # The states.

    def _wait(self, missing: str) -> DriveOrder:
        """Wait for something; for a moment the last goal is kept."""
        self.state = ExplorationState.WAITING
        self.text = f"waiting for {missing}"
        if self._clock.now - self._complete_at < _PATIENCE and not self._is_paused:
            return DriveOrder(STOP, self._desk.pose, self._desk.number)
        return self._desk.order(STOP, None)

    def _find_missing(self, pose: Pose2D | None, scan: LaserScan | None) -> str:
        """What a step waits for, in words; empty if nothing is missing."""
        if self._grid is None:
            return "a map"
        if not (self._grid.cells != UNKNOWN).any():
            return "a map that shows anything"
        if pose is None or not all(map(math.isfinite, pose)):
            return "the robot's pose on the map"
        left, bottom, right, top = self._grid.frame.bounds
        if not (left <= pose.x < right and bottom <= pose.y < top):
            return f"a map of where the robot is, ({pose.x:.1f}, {pose.y:.1f}) m"
        return "a scan" if scan is None and self._context.drives else ""

    def _explore(
        self,
        pilot: FrontierPilot,
        grid: OccupancyGrid,
        pose: Pose2D,
        ranges: Float32Array,
        mates: FloatArray,
    ) -> DriveOrder:
        loop = pilot.loop
        now = self._clock.now
        if loop.finished:
            if now < self._trials.again_at:
                return self._stand_between_tries(loop)
            loop.forgive()
        observation = {
            "map": grid,
            "scan": ranges,
            "pose": np.array(pose),
            "time": np.array([now]),
            "mates": np.insert(mates, 0, 1.0, axis=1),
        }
        twist = pilot.act(observation)
        if not loop.finished:
            self._trials.note(loop)
            is_blocked = self._trials.is_blocked
            self.state = ExplorationState.BLOCKED if is_blocked else ExplorationState.EXPLORING
            frontiers = counted(loop.num_frontiers, "frontier")
            self.text = f"{self.state.value}: {frontiers}, {loop.known_area:.0f} m2 known"
            return self._order(twist, loop.navigator)
        has_place = knows_place(grid, pose, self.settings.robot_radius)
        is_lost = loop.navigator.reachable is None or not has_place
        if not self._trials.is_over(loop, is_lost, now):
            return self._stand_between_tries(loop)
        return self._end(loop)

    def _end(self, loop: ExplorationLoop) -> DriveOrder:
        """End the exploration, or return to the start first."""
        self._is_over = True
        self._notes = [f"{loop.known_area:.0f} m2 known"]
        count = len(loop.unreached())
        if count > 0:
            self._notes.append(f"places not reached: {count}")
        if self.settings.return_to_start:
            self.return_to_start()
            return self._stand(ExplorationState.RETURNING, "returning to the start")
        return self._stand(ExplorationState.DONE, f"done: {'; '.join(self._notes)}")

    def _stand_between_tries(self, loop: ExplorationLoop) -> DriveOrder:
        """Stand between an end that isn't final and the next try."""
        count = len(loop.unreached())
        if count == 0:
            state = ExplorationState.WAITING
            text = "waiting for a map with a frontier that the robot can get to"
        elif self._trials.is_blocked:
            state = ExplorationState.BLOCKED
            text = f"blocked: no place was reached, left are {count}"
        else:
            state = ExplorationState.EXPLORING
            text = f"exploring: places not reached: {count}"
        return self._stand(state, f"{text}; trying again after {self._trials.pause:.0f} s")

    def _return(
        self, back: WayBack, grid: OccupancyGrid, pose: Pose2D, ranges: Float32Array
    ) -> DriveOrder:
        twist = back.step(grid, pose, ranges, self._clock.now)
        if back.result:
            self._back = None
            self._is_paused = not self._is_over
            self._notes.append(back.result)
        self.state = ExplorationState.RETURNING
        self.text = "returning to the start"
        return self._order(twist, back.navigator)

    def _stand(self, state: ExplorationState, text: str) -> DriveOrder:
        self.state = state
        self.text = text
        return self._desk.order(STOP, None)

    def _order(self, twist: Twist2D, navigator: Navigator) -> DriveOrder:
        return self._desk.order(twist, None if self._context.drives else navigator)

    def view(self) -> ExplorationView:
        """What viewers show."""
        if self._pilot is None or self._grid is None:
            return ExplorationView((), None, None, np.zeros((0, 2)), 0.0)
        loop = self._pilot.loop
        navigator = self._back.navigator if self._back else loop.navigator
        goal = navigator.goal if navigator.is_active else None
        return ExplorationView(
            tuple(one.points for one in loop.candidates),
            loop.target.points if loop.target else None,
            (goal.x, goal.y) if goal else None,
            navigator.follower.ahead if goal else np.zeros((0, 2)),
            loop.known_area,
        )

    def unreached(self) -> list[Point]:
        """Middles of the frontiers that were given up, which takes a search of the map's frontiers."""
        if self._pilot is None:
            return []
        return [one.frontier.middle for one in self._pilot.loop.unreached()]


def _make_pilot(name: str, context: ExplorerContext) -> FrontierPilot:
    """The pilot of an explorer of a name."""
    explorer = make_explorer(name, context)
    pilot = explorer.begin(0) if isinstance(explorer, BatchedExplorer) else None
    if not isinstance(pilot, FrontierPilot):
        raise ConfigError(
            f"the explorer {name} doesn't choose frontiers; take one that does, such as tour or rl"
        )
    return pilot
