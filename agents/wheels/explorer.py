"""The explorer ``wheels``: a trained policy drives, and nothing chooses a frontier or follows a path."""

from pathlib import Path

from slamgym.agents.explorer import BatchedExplorer, Pilot
from slamgym.agents.wheels.policy import WHEELS, WheelsPolicy, read_wheels
from slamgym.core.errors import ConfigError
from slamgym.core.types import Observation, OccupancyGrid, Pose2D, Twist2D
from slamgym.envs.compact import SCAN_SECTORS, CompactObserver, MapTiles
from slamgym.envs.completion import CompletionDetector
from slamgym.planning.context import ExplorerContext
from slamgym.planning.costmap import crop_known

_SMALLEST_FRONTIER = 0.5
"""Shorter frontiers don't keep it driving [m]."""


class WheelsPilot(Pilot):
    """Looks, asks the network, and holds its answer for some control steps.

    Args:
        context: What the environment says about the robot and its map.
        policy: The network.
    """

    def __init__(self, context: ExplorerContext, policy: WheelsPolicy) -> None:
        self._context, self._policy = context, policy
        limits = context.max_linear, context.max_angular, context.geometry.range_max
        self._observer = CompactObserver(
            context.geometry.num_beams, limits, policy.network.crop_side, looks_far=True
        )
        self._detector = CompletionDetector(context.robot_radius, _SMALLEST_FRONTIER)
        self._steps = 0
        self._command = Twist2D(0.0, 0.0)
        self._publication = round(context.map_update_interval / context.control_step) or 1

    def act(self, observation: Observation) -> Twist2D:
        """Velocity for the next control step; see :meth:`Pilot.act`."""
        context, cells = self._context, observation["map"][0]
        pose = Pose2D(*observation["pose"].tolist())
        if self._steps % self._publication == 0:
            grid = crop_known(OccupancyGrid(cells, context.frame), pose)
            self.finished = self._detector.is_explored(grid, pose)
            self._shown = MapTiles.of_grid(cells, context.frame)
            self._observer.refresh(self._shown)
        if self._steps % self._policy.network.hold == 0:
            velocity = Twist2D(*observation["velocity"].tolist())
            seen = self._observer.observe(self._shown, observation["scan"], pose, velocity)
            linear, angular = self._policy.act(seen).tolist()
            self._command = Twist2D(linear * context.max_linear, angular * context.max_angular)
            self.decisions += 1
        self._steps += 1
        return self._command


class WheelsExplorer(BatchedExplorer):
    """Drives the wheels by a trained network, from observations ``compact_far`` of the published map.

    Args:
        context: What the environment says about the robot and its map.
        policy: Weights, as ``slamgym agents train --env explore`` writes them; by default those of the package.

    Raises:
        ConfigError: If the scanner has too few beams.
        InputFileError: If the weights are missing, damaged, or made for other observations.
    """

    def __init__(self, context: ExplorerContext, policy: Path | str = WHEELS) -> None:
        if context.geometry.num_beams < SCAN_SECTORS:
            raise ConfigError(
                f"the explorer wheels needs a scanner of {SCAN_SECTORS} beams or more, not {context.geometry.num_beams}"
            )
        self._policy = read_wheels(policy)
        super().__init__(context, self._policy.fingerprint)

    def _begin(self, index: int) -> Pilot:  # noqa: ARG002 - every environment begins alike
        return WheelsPilot(self.context, self._policy)
