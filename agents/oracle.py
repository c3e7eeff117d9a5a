"""The oracle: an explorer that knows the floor plan and sees everything on a short tour.

No robot can explore like this: it is a reference, and an expert to imitate. It drives by the same navigation stack
and recovery behaviours, with the same SLAM, as every other explorer; only where to go, and what lies behind the border
of the map, it takes from the plan, and what is left to see from the true coverage. It is made from an environment
(:meth:`Oracle.of`), never by a name and a context, so that no explorer gets the truth unasked.
"""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from slamgym.agents.coverage_tour import CoverageTourConfig, CoverageTourPlanner, Stop
from slamgym.core.config import Settings, config_hash
from slamgym.core.types import (
    OCCUPIED,
    UNKNOWN,
    BoolArray,
    ByteArray,
    Float32Array,
    FloatArray,
    IntArray,
    Observation,
    OccupancyGrid,
    Pose2D,
)
from slamgym.envs import ExploreEnv
from slamgym.envs.coverage import Coverage, ReachableFloor
from slamgym.planning import (
    CostmapConfig,
    ExplorerContext,
    Goal,
    GoalStatus,
    Navigator,
    NavigatorConfig,
    crop_known,
    make_costmap,
    reachable_space,
)
from slamgym.planning.coarse_paths import CoarsePaths
from slamgym.planning.frontiers import Point
from slamgym.planning.recovery import Recovery, RecoveryBehaviours
from slamgym.sim import Clutter


class TrueBuilding:
    """The building of an environment's running episode, and what has truly been seen of it. Privileged.

    Convention: points are in the world frame.

    Args:
        env: After its reset.
        config: How tours through it are planned.
        resolution: Cells of the drawing on which they are planned [m].

    Attributes:
        drawing: Walls and furniture on the canvas of the robot's map.
        planner: Plans tours through it.
        paths: Lengths of paths in it.
        start: Pose at which the robot began: the origin of the map frame.
    """

    def __init__(
        self, env: ExploreEnv, config: CoverageTourConfig | None = None, resolution: float = 0.05
    ) -> None:
        plan, clutter, robot = env.plan, env.clutter, env.config.robot
        self.start = env.start
        self._coverage: Coverage = env.coverage
        offset = self.start.x, self.start.y
        frame = replace(env.config.observation, map_resolution=resolution).frame()
        drawn = plan.raster(resolution, frame=frame, offset=offset, outside=UNKNOWN)
        self.drawing = _with_furniture(drawn, clutter, offset)
        known = crop_known(self.drawing, Pose2D(0.0, 0.0, 0.0))
        frame = known.frame._replace(
            origin_x=known.frame.origin_x + offset[0], origin_y=known.frame.origin_y + offset[1]
        )
        radius = robot.circumscribed_radius
        config_of_body = CostmapConfig(inscribed_radius=radius, inflation_radius=radius)
        costmap = make_costmap(OccupancyGrid(known.cells, frame), config_of_body)
        space = reachable_space(costmap, self.start)
        assert space is not None, "the robot stands in the building"
        floor = ReachableFloor(plan, robot.radius, clutter.passages)
        self.paths = CoarsePaths(costmap, space)
        self.planner = CoverageTourPlanner(
            costmap,
            space,
            floor.mask(self.start.x, self.start.y),
            floor.frame,
            np.vstack([plan.segments(), clutter.segments()]),
            env.config.usable_range,
            config,
        )

    @property
    def unseen(self) -> BoolArray:
        """Which of the planner's cells can be seen but truly have not been, shape (C,)."""
        seen = self._coverage.seen[::-1].reshape(-1)[self.planner.cells]
        unseen: BoolArray = self.planner.coverable & ~seen
        return unseen

    def to_world(self, point: Sequence[float] | FloatArray) -> Point:
        """A point of the map frame in the world frame [m]."""
        return float(point[0]) + self.start.x, float(point[1]) + self.start.y

    def to_map(self, point: Point) -> Point:
        """A point of the world frame in the map frame [m]."""
        return point[0] - self.start.x, point[1] - self.start.y


class OracleConfig(Settings):
    """Settings of the oracle."""

    tour: CoverageTourConfig = field(default_factory=CoverageTourConfig)
    """The tour."""
    replan_interval: float = 60.0
    """The tour is planned again when a stop is done, and after so long [s] at the latest. In rings of rooms two
    directions are alike, and a robot that reconsidered every few seconds would turn back time and again."""
    keeps_tour: bool = True
    """Whether an earlier tour is kept as long as no shorter one is found."""
    looks: int = 4
    """A stop is looked round from in so many directions."""
    enough: float = 0.06
    """A stop is done when less than this is left of what it is for [m2]."""
    relaxed_footprints: tuple[float, ...] = (0.85, 0.6)
    """At the end also doors that a robot of these shares of the radius could pass: maps draw walls too thick."""
    worth_squeezing: float = 1.0
    """That is tried for the sake of so much unseen floor [m2]."""
    navigator: NavigatorConfig = field(default_factory=NavigatorConfig)
    """Navigation stack."""


@dataclass
class _Failures:
    """What the robot has tried without success since its failures were last cleared."""

    hopeless: BoolArray  # cells that weren't seen from where they should be, shape (C,)
    banned: frozenset[int] = frozenset()  # places that it failed to get to
    visits: Counter[int] = field(default_factory=Counter)  # of each place

    def __bool__(self) -> bool:
        return bool(self.banned or self.hopeless.any())


class Oracle:
    """One exploration that knows the building; an ``Explorer`` for one environment.

    Args:
        context: What any explorer knows.
        building: What only this one knows, drawn on the frame of the observation's map.
        config: Settings.

    Attributes:
        tour: The stops that are left, the next one first.
        decisions: How often the tour was planned.
        finished: Whether what can be seen was seen.
        fingerprint: Short hash of the settings.
    """

    def __init__(
        self, context: ExplorerContext, building: TrueBuilding, config: OracleConfig | None = None
    ) -> None:
        self.config = config or OracleConfig()
        self.fingerprint = config_hash(self.config)
        self.context = context
        self.building = building
        self._navigator = Navigator(context, self.config.navigator)
        self._recovery = RecoveryBehaviours(
            context,
            self._navigator,
            look_around_before=0.0,
            relaxed_footprints=self.config.relaxed_footprints,
            closed_room_looks=0,  # the plan is known: no room is closed
        )
        self._failures = self._no_failures()
        self._is_last_round = False
        self._map: ByteArray | None = None
        self._planned_at = -math.inf
        self.tour: list[Stop] = []
        self.decisions = 0
        self.finished = False

    @staticmethod
    def of(env: ExploreEnv, seed: int = 0, config: OracleConfig | None = None) -> "Oracle":
        """The oracle of the episode that an environment has just started. Privileged.

        Args:
            env: An environment after :meth:`~slamgym.envs.ExploreEnv.reset`.
            seed: Unused: nothing here is random.
            config: Settings.
        """
        del seed
        context = env.explorer_context()
        building = TrueBuilding(env, config.tour if config else None, context.frame.resolution)
        return Oracle(context, building, config)

    def reset(self) -> None:
        """Refuse: another episode needs another floor plan.

        Raises:
            RuntimeError: Always.
        """
        raise RuntimeError("an oracle is made for one episode; make another")

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
        unseen: BoolArray = self.building.unseen & ~self._failures.hopeless
        return unseen

    def _no_failures(self) -> _Failures:
        return _Failures(np.zeros(len(self.building.planner.cells), dtype=np.bool_))

    def _take_map(self, cells: ByteArray, pose: Pose2D, time: float) -> None:
        """Hand the map to the navigation stack, its unknown part filled in from the plan."""
        if cells is self._map:
            return
        self._map = cells
        known = cells.reshape(self.context.frame.shape)
        filled = np.where(known == UNKNOWN, self.building.drawing.cells, known)
        self._navigator.update_map(OccupancyGrid(filled, self.context.frame), pose, time)

    def _is_plan_due(self, time: float) -> bool:
        """Whether the goal has ended, is needless, or the plan has grown old."""
        status = self._navigator.status
        if not self.tour or status is GoalStatus.IDLE:
            return True
        place, left = self.tour[0].place, self._left_of(self.tour[0])
        if status is GoalStatus.ABORTED:
            self._failures.banned |= {place}
            return True
        if status is GoalStatus.SUCCEEDED:
            self._failures.visits[place] += 1
            if self._failures.visits[place] >= self.config.looks:
                # What isn't seen in so many looks can't be seen because of errors of the pose, for now.
                self._failures.hopeless[left] = True
            return True
        done = self._area(len(left)) < self.config.enough
        return done or time - self._planned_at >= self.config.replan_interval

    def _plan(self, pose: Pose2D, time: float) -> None:
        """Plan the tour and go to its first stop."""
        planner, failures = self.building.planner, self._failures
        self._planned_at = time
        self.decisions += 1
        previous = [stop.place for stop in self.tour] if self.config.keeps_tour else []
        here = self.building.to_world(pose[:2])
        self.tour = planner.plan(self.unseen, here, failures.banned, previous, self._path_lengths(pose))
        while self.tour:
            stop = self.tour[0]
            look_at = self.building.to_map(planner.middle_of(self._left_of(stop)))
            self._navigator.set_goal(Goal(*self.building.to_map(stop.point), look_at=look_at), pose, time)
            if self._navigator.is_active:
                return
            failures.banned |= {stop.place}
            self.tour = self.tour[1:]
        self._navigator.cancel()
        # What was given up may be possible now: maps get better. Else doors may be drawn too narrow.
        again = not self._is_last_round and bool(failures)
        if not again and self._area(int(np.count_nonzero(self.unseen))) >= self.config.worth_squeezing:
            again = self._recovery.attempt(pose, time) is Recovery.RELAXED_FOOTPRINT
        self.finished = not again
        self._is_last_round = True
        self._failures = self._no_failures()

    def _path_lengths(self, pose: Pose2D) -> FloatArray | None:
        """Path length to each of the planner's places by the map that the robot drives on [m].

        Errors of the map may close a door that is open: the tour must not lead through it time and again.
        """
        costmap, space = self._navigator.costmap, self._navigator.reachable
        if costmap is None or space is None:
            return None
        paths = CoarsePaths(costmap, space)
        lengths = paths.lengths_from(paths.place((pose.x, pose.y)))
        start = self.building.start
        to_places = paths.lengths_to(lengths, self.building.planner.places - [start.x, start.y])
        return to_places if np.isfinite(to_places).any() else None

    def _left_of(self, stop: Stop) -> IntArray:
        """What of a stop's cells is still unseen."""
        left: IntArray = stop.cells[self.unseen[stop.cells]]
        return left

    def _area(self, cells: int) -> float:
        """Floor that so many of the planner's cells stand for [m2]."""
        return cells * self.building.planner.cell_area


def _with_furniture(grid: OccupancyGrid, clutter: Clutter, offset: Point) -> OccupancyGrid:
    """A drawing with the furniture in it; ``offset`` is where its origin lies in the world [m]."""
    cells = grid.cells.copy()
    for solid in clutter.solids():
        corners = solid - offset
        row, col = grid.frame.to_cell(corners[:, 0], corners[:, 1])
        cv2.fillPoly(cells, [np.column_stack([col, row]).astype(np.int32)], int(OCCUPIED))
    return OccupancyGrid(cells, grid.frame)
