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
        self._prepared, self._world_from_map, self._newest = (
            prepared,
            Pose2D(start.x, start.y, 0.0),
            newest,
        )
        grid = newest()
        self._grid: OccupancyGrid | None = None  # the one measured last
        self._before: OccupancyGrid | float = OccupancyGrid(grid.cells.copy(), grid.frame)
        self._error, self._step, self.is_read = math.nan, 0, False

    def measure(self, grid: OccupancyGrid | None = None) -> float:
        """Mean distance of the newest map's occupied cells, or of a map's, from the nearest true obstacle [m]."""
        grid = self._newest() if grid is None else grid
        if grid is not self._grid:
            self._grid, self._error = (
                grid,
                self._obstacle_distance.mean_error(grid, self._world_from_map),
            )
        return self._error

    def of_next_step(self) -> Callable[[], tuple[float, float]]:
        """Measures the errors for the record of a new step, when called before the one after it."""
        if self.is_read:
            self._before = self._error
        self._step, self.is_read = self._step + 1, False
        return partial(self._read, self._step)

    def _read(self, step: int) -> tuple[float, float]:
        if step != self._step:
            return math.nan, math.nan
        if isinstance(self._before, OccupancyGrid):
            self._before = self.measure(self._before)
        if not self.is_read:
            self.is_read, _ = True, self.measure()
        return self._before, self._error

    @cached_property
    def _obstacle_distance(self) -> ObstacleDistance:
        # Kept for the episode alone: a field takes megabytes, and an environment keeps dozens of plans ready.
        parts = self._prepared.plan, self._prepared.clutter
        return ObstacleDistance(np.vstack([part.segments() for part in parts]))


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
        start, floor = simulation.start, prepared.floor
        self._prepared, self._simulation = prepared, simulation
        self.map_error = MapError(prepared, start, simulation.mapper.occupancy_grid)
        self._reward = reward
        self.coverage = Coverage(floor.mask(start.x, start.y), floor.frame, geometry, usable_range)
        self.look()
        self.latest = self._record(
            None, duration=0.0, distance=0.0, contact=False, terminated=False
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
        step = {"distance": motion.distance, "contact": motion.contact}
        self.latest = self._record(self.latest, duration=duration, terminated=terminated, **step)
        return self.latest

    def conclude(self) -> tuple[float, dict[str, float]]:
        """Let the latest step be the last: what that adds to its reward, and to each term."""
        goes_on = self._reward(self.latest)
        self.latest = replace(self.latest, terminated=True)
        ends = self._reward(self.latest)
        return ends[0] - goes_on[0], {
            name: value - goes_on[1][name] for name, value in ends[1].items()
        }

    def info(self) -> dict[str, Any]:
        """The newest figures, as ``info`` shows them."""
        simulation, latest = self._simulation, self.latest
        pose = simulation.true_pose
        info = {
            "coverage": latest.coverage,
            "path_length": simulation.path_length,
            "collisions": simulation.collisions,
            "pose_error": latest.pose_error,
            "heading_error": abs(wrap_angle(simulation.believed_pose.theta - pose.theta)),
            "doubtful_scans": len(simulation.mapper.stats.doubtful),
            "is_doubtful": simulation.mapper.stats.is_doubtful,
            "true_pose": np.array(pose),
        }
        if self.map_error.is_read:
            info["map_error"] = latest.map_error
        return info

    def scene(self, log: EpisodeLog) -> Scene:
        """Contents of a picture of the episode, all in the world frame.

        Args:
            log: The paths so far.
        """
        plan, clutter, simulation = self._prepared.plan, self._prepared.clutter, self._simulation
        start, belief, latest = simulation.start, simulation.believed_pose, self.latest
        grid = simulation.mapper.occupancy_grid()
        frame = grid.frame._replace(
            origin_x=grid.frame.origin_x + start.x, origin_y=grid.frame.origin_y + start.y
        )
        return Scene(
            plan=plan,
            furniture=simulation.world.furniture(),
            moving=simulation.world.segments()[len(plan.segments()) + len(clutter.segments()) :],
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
                time=latest.time,
                coverage=latest.coverage,
                path_length=simulation.path_length,
                pose_error=latest.pose_error,
                contacts=simulation.collisions,
            ),
        )

    def _record(self, before: StepRecord | None, **step: Any) -> StepRecord:
        """The record of a step, after that of the last one."""
        simulation, share = self._simulation, self.coverage.share
        pose, truth = simulation.believed_pose, simulation.true_map_pose
        return StepRecord(
            **step,
            time=simulation.time,
            coverage=share,
            previous_coverage=before.coverage if before else share,
            pose_error=math.hypot(pose.x - truth.x, pose.y - truth.y),
            floor_area=self.coverage.floor_area,
            map_errors=self.map_error.of_next_step(),
        )
