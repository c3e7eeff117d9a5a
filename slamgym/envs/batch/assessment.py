"""Explorations measured against the truth: the records that rewards see, and the figures of ``info``."""

from collections.abc import Callable
from functools import cached_property, partial
from typing import Any

import numpy as np

from slamgym.core.geometry import wrap_angle
from slamgym.core.types import UNKNOWN, BoolArray, FloatArray, IntArray, OccupancyGrid, Pose2D
from slamgym.envs.batch.beliefs import Beliefs
from slamgym.envs.completion import CompletionDetector
from slamgym.envs.coverage import CELL
from slamgym.envs.plan_cache import PreparedPlan
from slamgym.envs.records import StepRecord
from slamgym.envs.rewards import Reward
from slamgym.metrics.map_error import ObstacleDistance
from slamgym.sim.motion import clearance

_PLACE_ONLY = np.array([1.0, 1.0, 0.0])
OF_MAP = ("map_error", "known_area", "entropy")
"""Figures of a map alone, of which a record has the one before the step too."""


class MapFigures:
    """Figures of one episode's map, measured where a reward reads them.

    Args:
        prepared: The building.
        start: Where the robot began, world frame.
        newest: Gives the map.
        keeps_first: True to keep the first map, for figures from before the first that is read.
    """

    def __init__(
        self,
        prepared: PreparedPlan,
        start: Pose2D,
        newest: Callable[[], OccupancyGrid],
        keeps_first: bool,
    ) -> None:
        self._prepared = prepared
        self._start = start
        self._newest = newest
        self._first: OccupancyGrid | None = None
        if keeps_first:
            self._first = newest()
        self._measured: dict[str, tuple[OccupancyGrid, float]] = {}  # the newest
        self._read: dict[str, tuple[int, float, float]] = {}  # at which step, before it, after it

    def at(self, step: int, name: str) -> tuple[float, float]:
        """A figure before a step and after it; to be read in that step."""
        read_at, before, after = self._read.get(name, (-1, 0.0, 0.0))
        if read_at != step:
            before = self.of(name, self._first) if read_at < 0 else after
            after = self.of(name)
            self._read[name] = step, before, after
        return before, after

    def is_read(self, step: int, name: str) -> bool:
        """True if a figure was read in a step."""
        return name in self._read and self._read[name][0] == step

    def of(self, name: str, grid: OccupancyGrid | None = None) -> float:
        """A figure of a map, by default of the newest."""
        grid = self._newest() if grid is None else grid
        known, value = self._measured.get(name, (None, 0.0))
        if grid is not known:
            value = getattr(self, f"_{name}")(grid)
            self._measured[name] = grid, value
        return value

    def _map_error(self, grid: OccupancyGrid) -> float:
        """Mean distance of occupied cells from the nearest true obstacle [m]."""
        world_from_map = Pose2D(self._start.x, self._start.y, 0.0)
        return self._obstacle_distance.mean_error(grid, world_from_map)

    @cached_property
    def _obstacle_distance(self) -> ObstacleDistance:
        # Kept for the episode alone: a field takes megabytes, and an environment keeps dozens of plans ready.
        walls = self._prepared.plan.segments()
        furniture = self._prepared.clutter.segments()
        return ObstacleDistance(np.vstack([walls, furniture]))

    def _known_area(self, grid: OccupancyGrid) -> float:
        return grid.known_area

    def _entropy(self, grid: OccupancyGrid) -> float:
        """Unknown cells in the building's bounding box."""
        min_x, min_y, max_x, max_y = self._prepared.plan.bounds
        size, x, y, _, _ = grid.frame
        left, right = (round((edge - self._start.x - x) / size) for edge in (min_x, max_x))
        bottom, top = (round((edge - self._start.y - y) / size) for edge in (min_y, max_y))
        inside = grid.cells[::-1][max(bottom, 0) : max(top, 0), max(left, 0) : max(right, 0)]
        return float((right - left) * (top - bottom) - np.count_nonzero(inside != UNKNOWN))


class Assessment:
    """Measures explorations.

    Args:
        beliefs: What the robots believe; their fleet is the truth.
        reward: What will be read.
    """

    def __init__(self, beliefs: Beliefs, reward: Reward) -> None:
        self._beliefs = beliefs
        self._fleet = beliefs.fleet
        self._reward = reward
        count = len(self._fleet)
        self._maps: list[MapFigures] = []
        self._detectors: list[CompletionDetector] = []
        self._action = np.zeros((count, 2))
        self._path = np.zeros(count)
        self._coverage = np.zeros(count)
        self._steps = np.zeros(count, dtype=np.int64)
        self._step = 0  # of all that was ever assessed

    def begin(self, ids: IntArray) -> None:
        """Begin with robots that have scanned for the first time."""
        self._step += 1
        for i in ids.tolist():
            prepared = self._fleet.each[i].prepared
            start = Pose2D(*self._fleet.robots.start[i].tolist())
            newest = partial(self._beliefs.grid, i)
            figures = MapFigures(prepared, start, newest, self._reward.may_measure)
            if "map_error" in self._reward.terms:
                figures.at(self._step, "map_error")
            self._maps[i : i + 1] = [figures]
            self._detectors[i : i + 1] = [CompletionDetector.of(self._fleet.config)]
        # Copies, because the latest record has these arrays.
        self._action = np.array(self._action)
        self._coverage = np.array(self._coverage)
        self._action[ids] = 0.0
        self._coverage[ids] = self._fleet.shares[ids]
        self._path[ids] = 0.0
        self._steps[ids] = 0

    def is_explored(self, index: int) -> bool:
        """True if one robot's map shows no frontier that it could reach."""
        grid = self._beliefs.live_grid(index)
        return self._detectors[index].is_explored(grid, self._believed(index))

    def map_error(self, index: int) -> float:
        """Of one robot's newest map [m]."""
        return self._maps[index].of("map_error")

    def errors_read(self) -> BoolArray:
        """Whose map error was read since the last step, shape (N,)."""
        return np.array([figures.is_read(self._step, "map_error") for figures in self._maps])

    def record(self, targets: FloatArray, terminated: BoolArray) -> StepRecord:
        """The record of the step that ends now, of all robots.

        Args:
            targets: What they were asked for, within their limits, shape (N, 2).
            terminated: Whose exploration is complete, shape (N,).
        """
        self._step += 1
        robots = self._fleet.robots
        path = robots.path.copy()
        coverage = self._fleet.shares
        record = StepRecord(
            partial(self._read, self._step),
            duration=(robots.steps - self._steps) * self._fleet.config.control_step,
            time=self._fleet.times,
            action=targets,
            previous_action=self._action,
            distance=path - self._path,
            contact=robots.contact.copy(),
            coverage=coverage,
            previous_coverage=self._coverage,
            terminated=terminated,
        )
        self._action = targets
        self._path = path
        self._steps = robots.steps.copy()
        self._coverage = coverage
        return record

    def apart(self) -> tuple[FloatArray, FloatArray]:
        """Distances [m] and angles [rad] between believed and true poses, shape (N,)."""
        robots = self._fleet.robots
        apart = self._beliefs.maps.believed - (robots.pose - robots.start * _PLACE_ONLY)
        return np.hypot(apart[:, 0], apart[:, 1]), np.abs(wrap_angle(apart[:, 2]))

    def _read(self, step: int, name: str, index: int | None) -> Any:
        """Measure a figure of a record that wasn't made with it: of one robot, or of all."""
        if step != self._step:
            raise LookupError(f"{name!r} can be read in its own step alone")
        if index is None:
            return np.array([self._read(step, name, i) for i in range(len(self._fleet))])
        if name.removeprefix("previous_") in OF_MAP:
            before, after = self._maps[index].at(step, name.removeprefix("previous_"))
            return before if name.startswith("previous_") else after
        return getattr(self, f"_{name}")(index)

    def _believed(self, index: int) -> Pose2D:
        return Pose2D(*self._beliefs.maps.believed[index].tolist())

    def _pose(self, index: int) -> FloatArray:
        believed: FloatArray = self._beliefs.maps.believed[index].copy()
        return believed

    def _turning(self, index: int) -> float:
        return float(self._fleet.robots.driven[index, 2])

    def _pose_error(self, index: int) -> float:
        return float(self.apart()[0][index])

    def _contacts(self, index: int) -> int:
        return int(self._fleet.robots.collisions[index])

    def _revisits(self, index: int) -> int:
        return int(self._fleet.robots.revisits[index])

    def _floor_area(self, index: int) -> float:
        return float(self._fleet.scenes.floor_cells[index] * CELL**2)

    def _clearance(self, index: int) -> float:
        world = self._fleet.each[index].world
        x, y, _ = self._fleet.robots.pose[index].tolist()
        return float(clearance(x, y, world.building.obstacles, world.discs) - world.robot.radius)

    def _scan(self, index: int) -> Any:
        return self._beliefs.ranges[index].copy()

    def _covariance(self, index: int) -> FloatArray:
        if self._beliefs.is_mapped_together:
            return np.zeros((3, 3))
        return self._beliefs.mapper(index).covariance

    def _map(self, index: int) -> OccupancyGrid:
        return self._beliefs.grid(index)

    def _frontier_distance(self, index: int) -> float:
        grid = self._beliefs.grid(index)
        return self._detectors[index].distance_to_frontier(grid, self._believed(index))
