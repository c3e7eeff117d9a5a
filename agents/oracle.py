"""The privileged explorer: it is told the floor plan and sees everything on a short tour.

Nobody explores so: it is the yardstick, the "optimum with full knowledge", and an expert to imitate. It
drives by the same navigation stack, with the same SLAM, as every other explorer; only where to go, and what
lies behind the border of the map, it takes from the plan, and what is left to see from the true coverage. It is
made from an environment (:meth:`Oracle.of`), never by a name and a context, so that no explorer gets the
truth unasked.
"""

import math
from collections import Counter
from dataclasses import field
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from slamgym.agents.coverage_tour import SightConfig, SightPlanner, Stop
from slamgym.agents.explorer import Observation
from slamgym.core.config import Settings
from slamgym.core.types import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    BoolArray,
    ByteArray,
    Float32Array,
    FloatArray,
    OccupancyGrid,
    Pose2D,
)
from slamgym.envs import ExploreEnv
from slamgym.envs.coverage import Coverage, ReachableFloor
from slamgym.planning import (
    Costmap,
    CostmapConfig,
    ExplorerContext,
    Goal,
    GoalStatus,
    Navigator,
    NavigatorConfig,
    make_costmap,
    reachable_space,
)
from slamgym.planning.coarse_paths import CoarsePaths
from slamgym.planning.recovery import LastResorts, Resort
from slamgym.sim import Clutter


class FullKnowledgeConfig(Settings):
    """Settings of the privileged explorer."""

    sight: SightConfig = field(default_factory=SightConfig)
    """The tour."""
    replan_interval: float = 60.0
    """The tour is planned anew when a stop is done, and after so long [s] at the latest. In rings of rooms two
    ways round are alike, and a robot that reconsidered every few seconds would turn back time and again."""
    keeps_tour: bool = True
    """Whether an earlier tour is kept as long as no shorter one is found."""
    looks: int = 4
    """A stop is looked round from in so many directions."""
    enough: float = 0.06
    """A stop is done when less than this is left of what it is for [m2]."""
    last_radius_shares: tuple[float, ...] = (0.85, 0.6)
    """At the end also doors that a robot of these shares of the radius could pass: maps draw walls too thick."""
    worth_squeezing: float = 1.0
    """That is tried for the sake of so much unseen floor [m2]."""
    navigator: NavigatorConfig = field(default_factory=NavigatorConfig)
    """Navigation stack."""


class Oracle:
    """One exploration with full knowledge of the plan; satisfies ``PolicyPredictor`` for one environment.

    Args:
        context: What any explorer is told.
        drawing: The true building on the frame of the observation's map, shape ``context.frame.shape``.
        segments: Its walls and furniture, shape (S, 4) [m], world frame.
        floor: What is to be seen, as :class:`~slamgym.envs.coverage.Coverage` takes it, row 0 at the bottom.
        coverage: What has truly been seen of it, kept by the environment.
        start: Pose at which the robot begins, world frame: the origin of the map frame.
        reach: How far it sees for the purpose of mapping [m].
        config: Settings.

    Attributes:
        tour: The stops that are left, the next one first.
        decisions: How often the tour was planned.
        finished: Whether what can be seen was seen.
    """

    def __init__(
        self,
        context: ExplorerContext,
        drawing: ByteArray,
        segments: FloatArray,
        floor: BoolArray,
        coverage: Coverage,
        start: Pose2D,
        reach: float,
        config: FullKnowledgeConfig | None = None,
    ) -> None:
        self.config = config or FullKnowledgeConfig()
        self.context = context
        self._drawing = drawing
        self._origin = start
        frame = coverage.frame
        costmap = self._true_costmap(context)
        space = reachable_space(costmap, start)
        self._cell_area = (self.config.sight.every * frame.resolution) ** 2
        self._seen = coverage
        self.planner: SightPlanner | None = None
        self.finished = space is None
        if space is not None:
            self.planner = SightPlanner(costmap, space, floor, frame, segments, reach, self.config.sight)
            self._hopeless = np.zeros(len(self.planner.cells), dtype=np.bool_)
        self._navigator = Navigator(context, self.config.navigator)
        self._banned: frozenset[int] = frozenset()
        self._visits: Counter[int] = Counter()
        self._is_last_round = False
        self._last_resorts = LastResorts(
            context,
            self._navigator,
            look_around_before=0.0,
            radius_shares=self.config.last_radius_shares,
            closed_room_looks=0,  # the plan is known: no room is closed
        )
        self._map: ByteArray | None = None
        self._planned_at = -math.inf
        self.tour: list[Stop] = []
        self.decisions = 0

    @staticmethod
    def of(env: ExploreEnv, seed: int = 0, config: FullKnowledgeConfig | None = None) -> "Oracle":
        """The explorer of the episode that an environment has just begun. Privileged.

        Args:
            env: An environment after :meth:`~slamgym.envs.ExploreEnv.reset`.
            seed: Unused: nothing here is random.
            config: Settings.
        """
        del seed
        context, plan, start = env.explorer_context(), env.plan, env.start
        robot = env.config.robot
        floor = ReachableFloor(plan, robot.radius, env.clutter.furniture)
        frame = context.frame
        drawn = plan.raster(frame.resolution, frame=frame, offset=(start.x, start.y), outside=UNKNOWN)
        drawing = _with_furniture(drawn.cells, env.clutter, context, start)
        segments = np.vstack([plan.segments(), env.clutter.segments()])
        mask = floor.mask(start.x, start.y)
        reach = env.config.usable_range
        return Oracle(context, drawing, segments, mask, env.coverage, start, reach, config)

    def reset(self) -> None:
        """Refuse: another episode needs another floor plan.

        Raises:
            RuntimeError: Always.
        """
        raise RuntimeError("an explorer with full knowledge is made anew for each episode")

    def predict(
        self,
        observation: Observation,
        state: tuple[NDArray[Any], ...] | None = None,
        episode_start: NDArray[Any] | None = None,  # noqa: ARG002 - part of the protocol
        deterministic: bool = False,  # noqa: ARG002 - part of the protocol
    ) -> tuple[Float32Array, tuple[NDArray[Any], ...] | None]:
        """Choose the action of an unbatched observation, shape (2,); zeros once finished."""
        pose = Pose2D(*(float(value) for value in observation["pose"]))
        time = float(observation["time"][0])
        self._take_map(observation["map"], pose, time)
        if not self.finished and self._is_plan_due(time):
            self._plan(pose, time)
        if self.finished:
            return np.zeros(2, np.float32), state
        return self.context.to_action(self._navigator.step(pose, observation["scan"], time)), state

    @property
    def unseen(self) -> BoolArray:
        """Which of the planner's cells have truly not been seen, and can be."""
        assert self.planner is not None
        seen = self._seen.seen[::-1].reshape(-1)[self.planner.cells]
        return self.planner.coverable & ~seen & ~self._hopeless

    def _take_map(self, cells: ByteArray, pose: Pose2D, time: float) -> None:
        """Hand the map to the navigation stack, its unknown part filled in from the plan."""
        if cells is self._map:
            return
        self._map = cells
        known = cells.reshape(self.context.frame.shape)
        filled = np.where(known == UNKNOWN, self._drawing, known)
        self._navigator.update_map(OccupancyGrid(filled, self.context.frame), pose, time)

    def _is_plan_due(self, time: float) -> bool:
        """Whether the goal has ended, is needless, or the plan has grown old."""
        status = self._navigator.status
        if not self.tour or status is GoalStatus.IDLE:
            return True
        if status is GoalStatus.ABORTED:
            self._banned |= {self.tour[0].place}
            return True
        left = self._left_of(self.tour[0])
        if status is GoalStatus.SUCCEEDED:
            place = self.tour[0].place
            self._visits[place] += 1
            if self._visits[place] >= self.config.looks:
                # What isn't seen in so many looks can't be seen because of errors of the pose, for now.
                self._hopeless[left] = True
            return True
        done = len(left) * self._cell_area < self.config.enough
        return done or time - self._planned_at >= self.config.replan_interval

    def _plan(self, pose: Pose2D, time: float) -> None:
        """Plan the tour and go to its first stop."""
        assert self.planner is not None
        here = self._in_world(pose)
        self._planned_at = time
        self.decisions += 1
        previous = [stop.place for stop in self.tour] if self.config.keeps_tour else []
        self.tour = self.planner.plan(self.unseen, (here.x, here.y), self._banned, previous, self._ways(pose))
        while self.tour:
            stop = self.tour[0]
            x, y = self._in_map(stop.point)
            look_at = self._in_map(self.planner.middle_of(self._left_of(stop)))
            self._navigator.set_goal(Goal(x, y, look_at=look_at), pose, time)
            if self._navigator.status is GoalStatus.ACTIVE:
                return
            self._banned |= {stop.place}
            self.tour = self.tour[1:]
        self._navigator.cancel()
        # What was given up may be possible now: maps get better. Else doors may be drawn too narrow.
        again = not self._is_last_round and bool(self._banned or self._hopeless.any())
        if not again and np.count_nonzero(self.unseen) * self._cell_area >= self.config.worth_squeezing:
            again = self._last_resorts.attempt(pose, time) is Resort.GENTLER_RULES
        self.finished = not again
        self._is_last_round = True
        self._banned, self._visits = frozenset(), Counter()
        self._hopeless[:] = False

    def _ways(self, pose: Pose2D) -> FloatArray | None:
        """Path length to each of the planner's places by the map that the robot drives on [m].

        Errors of the map may close a door that is open: the tour must not lead through it time and again.
        """
        costmap, space = self._navigator.costmap, self._navigator.reachable
        assert self.planner is not None
        if costmap is None or space is None:
            return None
        paths = CoarsePaths(costmap, space)
        lengths = paths.lengths_from(paths.place((pose.x, pose.y)))
        ways = paths.lengths_to(lengths, self.planner.places - [self._origin.x, self._origin.y])
        return ways if np.isfinite(ways).any() else None

    def _left_of(self, stop: Stop) -> NDArray[np.int64]:
        """What of a stop's cells is still unseen."""
        left: NDArray[np.int64] = stop.cells[self.unseen[stop.cells]]
        return left

    def _in_world(self, pose: Pose2D) -> Pose2D:
        return Pose2D(pose.x + self._origin.x, pose.y + self._origin.y, pose.theta)

    def _in_map(self, point: tuple[float, float]) -> tuple[float, float]:
        return point[0] - self._origin.x, point[1] - self._origin.y

    def _true_costmap(self, context: ExplorerContext) -> Costmap:
        """The true building with the robot's body, world frame."""
        frame = context.frame
        rows, cols = (
            np.flatnonzero((self._drawing == FREE).any(axis=1)),
            np.flatnonzero((self._drawing == FREE).any(axis=0)),
        )
        top, bottom = max(0, rows[0] - 2), min(frame.height_px, rows[-1] + 3)
        left, right = max(0, cols[0] - 2), min(frame.width_px, cols[-1] + 3)
        window = type(frame)(
            frame.resolution,
            frame.origin_x + left * frame.resolution + self._origin.x,
            frame.origin_y + (frame.height_px - bottom) * frame.resolution + self._origin.y,
            int(bottom - top),
            int(right - left),
        )
        cells = np.ascontiguousarray(self._drawing[top:bottom, left:right])
        radius = context.robot_radius
        return make_costmap(
            OccupancyGrid(cells, window), CostmapConfig(inscribed_radius=radius, inflation_radius=radius)
        )


def _with_furniture(
    drawing: ByteArray, clutter: Clutter, context: ExplorerContext, start: Pose2D
) -> ByteArray:
    """The drawing with the furniture in it."""
    if not clutter.furniture:
        return drawing
    drawn = drawing.copy()
    for piece in clutter.furniture:
        corners = np.asarray(piece.exterior.coords) - [start.x, start.y]
        row, col = context.frame.to_cell(corners[:, 0], corners[:, 1])
        cv2.fillPoly(drawn, [np.column_stack([col, row]).astype(np.int32)], int(OCCUPIED))
    return drawn
