"""An exploration measured against the truth: for rewards and ``info``."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from slamgym.core.geometry import wrap_angle
from slamgym.core.types import LaserGeometry, OccupancyGrid, Pose2D
from slamgym.envs.coverage import Coverage
from slamgym.envs.plan_cache import PreparedPlan
from slamgym.envs.rewards import Reward, StepRecord
from slamgym.envs.simulation import EpisodeLog, Simulation
from slamgym.metrics.map_error import ObstacleDistance
from slamgym.sim import Motion
from slamgym.viz.exploration import Scene, SceneFigures


class MapError:
    """The error of one episode's map, measured where a reward reads it: that takes as long as half a step.

    Args:
        prepared: The building.
        start: Where the robot began, world frame.
        newest: Gives the map.

    Attributes:
        is_read: Whether a reward of the latest step read it.
    """

    def __init__(
        self, prepared: PreparedPlan, start: Pose2D, newest: Callable[[], OccupancyGrid]
    ) -> None:
        self._prepared = prepared
        self._world_from_map = Pose2D(start.x, start.y, 0.0)
        self._newest = newest
        grid = newest()
        self._grid: OccupancyGrid | None = None  # the one measured last
        self._before: OccupancyGrid | float = OccupancyGrid(grid.cells.copy(), grid.frame)
        self._error = math.nan
        self._step = 0
        self.is_read = False

    def measure(self, grid: OccupancyGrid | None = None) -> float:
        """Mean distance of the newest map's occupied cells, or of a map's, from the nearest true obstacle [m]."""
        if grid is None:
            grid = self._newest()
        if grid is not self._grid:
            self._grid = grid
            self._error = self._obstacle_distance.mean_error(grid, self._world_from_map)
        return self._error

    def of_next_step(self) -> Callable[[], tuple[float, float]]:
        """Measures the errors for the record of a new step, when called before the one after it."""
        if self.is_read:
            self._before = self._error
        self._step += 1
        self.is_read = False
        return partial(self._read, self._step)

    def _read(self, step: int) -> tuple[float, float]:
        if step != self._step:
            return math.nan, math.nan
        if isinstance(self._before, OccupancyGrid):
            self._before = self.measure(self._before)
        if not self.is_read:
            self.is_read = True
            self.measure()
        return self._before, self._error

    @cached_property
    def _obstacle_distance(self) -> ObstacleDistance:
        # Kept for the episode alone: a field takes megabytes, and an environment keeps dozens of plans ready.
        walls = self._prepared.plan.segments()
        furniture = self._prepared.clutter.segments()
        return ObstacleDistance(np.vstack([walls, furniture]))


class Assessment:
    """Measures one episode.

    Args:
        prepared: The building.
        simulation: The episode, at its start.
        geometry: The scanner.
        usable_range: How far the robot sees for the purpose of mapping [m].
        reward: Determines what has to be measured.

    Attributes:
        coverage: What was truly seen.
        latest: The record of the last step.
        map_error: Measures the map.
    """

    def __init__(
        self,
        prepared: PreparedPlan,
        simulation: Simulation,
        geometry: LaserGeometry,
        usable_range: float,
        reward: Reward,
    ) -> None:
        self._prepared = prepared
        self._simulation = simulation
        self._reward = reward
        start = simulation.start
        self.map_error = MapError(prepared, start, simulation.mapper.occupancy_grid)
        floor = prepared.floor.mask(start.x, start.y)
        self.coverage = Coverage(floor, prepared.floor.frame, geometry, usable_range)
        self.look()
        self.latest = self._record(
            self.coverage.share, duration=0.0, distance=0.0, contact=False, terminated=False
        )
        if "map_error" in reward.terms:
            _ = self.latest.map_error

    def look(self) -> None:
        """Account for the newest scan."""
        self.coverage.add(self._simulation.true_pose, self._simulation.true_ranges)

    def assess(self, motion: Motion, duration: float, terminated: bool) -> StepRecord:
        """Make the record of a step.

        Args:
            motion: What the robot did.
            duration: In [s].
            terminated: True if the exploration is complete.
        """
        self.latest = self._record(
            self.latest.coverage, duration, motion.distance, motion.contact, terminated
        )
        return self.latest

    def conclude(self) -> tuple[float, dict[str, float]]:
        """Let the latest step be the last: what that adds to its reward, and to each term."""
        reward, terms = self._reward(self.latest)
        self.latest = replace(self.latest, terminated=True)
        last_reward, last_terms = self._reward(self.latest)
        added = {name: value - terms[name] for name, value in last_terms.items()}
        return last_reward - reward, added

    def info(self) -> dict[str, Any]:
        """The newest figures, as ``info`` shows them."""
        simulation = self._simulation
        stats = simulation.mapper.stats
        pose = simulation.true_pose
        info = {
            "coverage": self.latest.coverage,
            "path_length": simulation.path_length,
            "collisions": simulation.collisions,
            "pose_error": self.latest.pose_error,
            "heading_error": abs(wrap_angle(simulation.believed_pose.theta - pose.theta)),
            "doubtful_scans": len(stats.doubtful),
            "is_doubtful": stats.is_doubtful,
            "true_pose": np.array(pose),
        }
        if self.map_error.is_read:
            info["map_error"] = self.latest.map_error
        return info

    def scene(self, log: EpisodeLog) -> Scene:
        """Contents of a picture of the episode, all in the world frame.

        Args:
            log: The paths so far.
        """
        plan = self._prepared.plan
        simulation = self._simulation
        world = simulation.world
        start = simulation.start
        belief = simulation.believed_pose
        grid = simulation.mapper.occupancy_grid()
        frame = grid.frame._replace(
            origin_x=grid.frame.origin_x + start.x, origin_y=grid.frame.origin_y + start.y
        )
        num_fixed = len(plan.segments()) + len(self._prepared.clutter.segments())
        return Scene(
            plan=plan,
            furniture=world.furniture(),
            moving=world.segments()[num_fixed:],
            robot_radius=simulation.radius,
            true_pose=simulation.true_pose,
            believed_pose=Pose2D(belief.x + start.x, belief.y + start.y, belief.theta),
            scan=simulation.scan,
            true_ranges=simulation.true_ranges,
            grid=OccupancyGrid(grid.cells, frame),
            seen=self.coverage.seen,
            seen_frame=self.coverage.frame,
            true_path=log.true_poses[:, :2],
            believed_path=log.estimates[:, :2] + [start.x, start.y],
            figures=SceneFigures(
                time=self.latest.time,
                coverage=self.latest.coverage,
                path_length=simulation.path_length,
                pose_error=self.latest.pose_error,
                contacts=simulation.collisions,
            ),
        )

    def _record(
        self,
        previous_coverage: float,
        duration: float,
        distance: float,
        contact: bool,
        terminated: bool,
    ) -> StepRecord:
        """The record of the step that ends now."""
        simulation = self._simulation
        pose = simulation.believed_pose
        truth = simulation.true_map_pose
        return StepRecord(
            duration=duration,
            time=simulation.time,
            distance=distance,
            contact=contact,
            coverage=self.coverage.share,
            previous_coverage=previous_coverage,
            pose_error=math.hypot(pose.x - truth.x, pose.y - truth.y),
            terminated=terminated,
            floor_area=self.coverage.floor_area,
            map_errors=self.map_error.of_next_step(),
        )
