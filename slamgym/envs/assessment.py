"""An exploration measured against the truth: for rewards and ``info``."""

import math
from dataclasses import replace
from functools import cached_property
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
        self._prepared, self._simulation, self._reward = prepared, simulation, reward
        self.coverage = Coverage(floor.mask(start.x, start.y), floor.frame, geometry, usable_range)
        self.look()
        self.latest = self._record(None, duration=0.0, distance=0.0, contact=False, terminated=False)

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
        return ends[0] - goes_on[0], {name: value - goes_on[1][name] for name, value in ends[1].items()}

    def map_error(self) -> float:
        """Mean distance of the map's occupied cells from the nearest true obstacle [m]."""
        grid = self._simulation.mapper.occupancy_grid()
        return self._obstacle_distance.mean_error(grid, self._simulation.world_from_map)

    @cached_property
    def _obstacle_distance(self) -> ObstacleDistance:
        # Kept for the episode alone: a field takes megabytes, and an environment keeps dozens of plans ready.
        parts = self._prepared.plan, self._prepared.clutter
        return ObstacleDistance(np.vstack([part.segments() for part in parts]))

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
        if self._reward.needs_map_error:
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
        """The record of a step, after that of the last one; what no reward looks at is nan."""
        simulation, reward, share = self._simulation, self._reward, self.coverage.share
        pose, truth = simulation.believed_pose, simulation.true_map_pose
        if before is not None and not simulation.is_new_scan_processed:
            map_error = before.map_error  # the map is the same
        else:
            map_error = self.map_error() if reward.needs_map_error else math.nan
        return StepRecord(
            **step,
            time=simulation.time,
            coverage=share,
            previous_coverage=before.coverage if before else share,
            pose_error=math.hypot(pose.x - truth.x, pose.y - truth.y),
            map_error=map_error,
            previous_map_error=before.map_error if before else map_error,
            floor_area=self.coverage.floor_area,
        )
