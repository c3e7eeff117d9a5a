"""A person at the keyboard: looks at the growing map and drives a robot through a building until content.

TurtleBot3's ``turtlebot3_teleop`` sets a speed by key presses, so people drive straight on, stop, and turn on the
spot, at a speed of their liking. Here they go to the nearest part of the map that is still open, and then drive
through rooms once more until the map looks good to them. They see the floor of the simulator's window, too: where
a scan meets nothing they drive on, though the map shows nothing there. What differs from person to person is
drawn: speed, rate of turn, how small an opening is still looked into, and how often they go back.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from slamgym.agents.explorer import BatchedExplorer, FrontierPilot, Pilot
from slamgym.agents.rules import Nearest
from slamgym.core.config import Settings, config_hash
from slamgym.core.geometry import compose, unit_vectors
from slamgym.core.types import FREE, UNKNOWN, ByteArray, Observation, Pose2D, Twist2D
from slamgym.envs.coverage import sweep
from slamgym.planning.context import ExplorerContext
from slamgym.planning.exploration_loop import ExplorationLoopConfig
from slamgym.planning.navigator import Goal, GoalStatus, NavigatorConfig
from slamgym.planning.path_follower import FollowerConfig

_VIEW = 0.15
"""Share of the scanner's range that is floor for sure where nothing returned."""
_TRIES = 5
"""So many places are tried for a visit that no path leads to."""


class TeleopConfig(Settings):
    """Ranges from which each driver's habits are drawn evenly."""

    speed: tuple[float, float] = (0.15, 0.26)
    """Forward speed; the keys' limits are 0.22 m/s for a Burger and 0.26 m/s for a Waffle, at 0.01 a press [m/s]."""
    turn_rate: tuple[float, float] = (0.4, 1.2)
    """Rate of turn on the spot, at 0.1 a press; few dare the 1.82 that is possible [rad/s]."""
    opening: tuple[float, float] = (0.4, 0.7)
    """Narrower open parts of the map are not looked into at first [m]."""
    visits: tuple[int, int] = (0, 4)
    """Places that are driven to again once nothing is open."""
    heading_error: float = 0.25
    """The driver stops to turn at this error of the heading [rad]."""
    patience: float = 120.0
    """For so long a driver goes on who doesn't come nearer: slow, but with a view of the whole way [s]."""
    straight: float = 0.05
    """Slower turns are no press of a key: the robot goes straight [rad/s]."""


class _Habits(NamedTuple):
    """One driver."""

    speed: float  # [m/s]
    turn_rate: float  # [rad/s]
    opening: float  # [m]
    visits: int

    @staticmethod
    def draw(config: TeleopConfig, rng: np.random.Generator) -> "_Habits":
        speed, rate, opening = (
            rng.uniform(*ends) for ends in (config.speed, config.turn_rate, config.opening)
        )
        return _Habits(speed, rate, opening, int(rng.integers(config.visits[0], config.visits[1] + 1)))


class _Driver(Pilot):
    """First to what is open, then through the building again."""

    def __init__(self, context: ExplorerContext, config: TeleopConfig, rng: np.random.Generator) -> None:
        habits = _Habits.draw(config, rng)
        follower = FollowerConfig(
            turn_in_place=config.heading_error,
            turned=0.05,
            turn_rate=habits.turn_rate,
        )
        loop = ExplorationLoopConfig(
            min_frontier_size=habits.opening,
            progress_timeout=config.patience,
            navigator=NavigatorConfig(follower=follower, progress_time=config.patience),
        )
        slow = replace(context, max_linear=min(habits.speed, context.max_linear))
        self._config, self._rng = config, rng
        self._explorer = FrontierPilot(slow, loop, Nearest())
        self.loop = self._explorer.loop
        self._visits_left = habits.visits
        self._directions = unit_vectors(context.geometry.angles)
        self._unseen = np.ones(context.frame.shape, dtype=np.bool_)  # row 0 at the bottom
        self._published: ByteArray | None = None
        self._shown: ByteArray | None = None

    def act(self, observation: Observation) -> Twist2D:
        """Velocity for the next control step; see :meth:`Pilot.act`."""
        loop = self._explorer.loop
        observation = {**observation, "map": self._with_floor(observation)}
        if not loop.finished:
            command = self._explorer.act(observation)
            self.decisions = self._explorer.decisions
        else:
            loop.observe(observation)
            if loop.navigator.status is not GoalStatus.ACTIVE:
                self._visit()
            command = loop.navigator.step(loop.pose, observation["scan"], loop.time)
        if command.linear > 0.0 and abs(command.angular) < self._config.straight:
            return Twist2D(command.linear, 0.0)
        return command

    def _with_floor(self, observation: Observation) -> ByteArray:
        """The map, with the floor that was seen where scans met nothing."""
        published: ByteArray = observation["map"]
        if self._shown is not None and published is self._published and not published.flags.writeable:
            return self._shown
        context = self._explorer.loop.context
        laser, frame, scan = context.geometry, context.frame, observation["scan"]
        sensor = compose(Pose2D(*observation["pose"].tolist()), laser.mount)
        open_ranges = np.where(scan >= laser.range_max, np.inf, 0.0)
        place = (frame.origin_x, frame.origin_y, frame.resolution)
        sweep(self._unseen, *place, *sensor, self._directions, open_ranges, _VIEW * laser.range_max)
        shown = published.copy()
        cells = shown.reshape(frame.shape)
        cells[(cells == UNKNOWN) & ~self._unseen[::-1]] = FREE
        shown.flags.writeable = False
        self._published, self._shown = published, shown
        return shown

    def _visit(self) -> None:
        """Drive to some place that the robot can get to, or be content."""
        navigator, pose, time = (
            self._explorer.loop.navigator,
            self._explorer.loop.pose,
            self._explorer.loop.time,
        )
        navigator.cancel()
        self.finished = self._visits_left == 0 or navigator.costmap is None or navigator.reachable is None
        self._visits_left -= 1
        for _ in range(_TRIES):
            if (
                self.finished
                or navigator.is_active
                or navigator.costmap is None
                or navigator.reachable is None
            ):
                return
            self.decisions += 1
            cell = navigator.reachable.order[self._rng.integers(navigator.reachable.num_centre)]
            row, col = divmod(int(cell), navigator.costmap.costs.shape[1])
            x, y = navigator.costmap.frame.to_point(row, col)
            navigator.set_goal(Goal(float(x), float(y)), pose, time)


class Teleop(BatchedExplorer):
    """A person who drives by keyboard; each environment of a batch has a driver of its own.

    Args:
        context: What the environment says about the robot and its map.
        seed: Of the drivers' habits and of the places that they visit again.
        config: Ranges of the habits.
    """

    def __init__(self, context: ExplorerContext, seed: int = 0, config: TeleopConfig | None = None) -> None:
        self.config = config or TeleopConfig()
        super().__init__(context, config_hash(self.config))
        self._seed = seed

    def _begin(self, index: int) -> Pilot:
        return _Driver(self.context, self.config, np.random.default_rng([self._seed, index]))
