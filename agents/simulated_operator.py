"""A simulated person at the keyboard, who looks at the growing map and drives until content with it.

TurtleBot3's ``turtlebot3_teleop`` sets a speed by key presses, so people drive straight on, stop, and turn on the
spot, at a speed of their liking. Here they go to the nearest part of the map that is still open, and then drive
through rooms once more until the map looks good to them. They see the floor of the simulator's window, too: where
a scan meets nothing they drive on, though the map shows nothing there. What differs from person to person is
drawn: speed, rate of turn, how small an opening is still looked into, and how often they go back.
"""

from dataclasses import replace

import numpy as np

from slamgym.agents.explorer import BatchedExplorer, FrontierPilot, Pilot
from slamgym.agents.rules import Nearest
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
_SPEED = (0.15, 0.26)
"""Forward speeds; the keys' limits are 0.22 m/s for a Burger and 0.26 m/s for a Waffle, at 0.01 a press [m/s]."""
_TURN_RATE = (0.4, 1.2)
"""Rates of turn on the spot, at 0.1 a press; few dare the 1.82 that is possible [rad/s]."""
_OPENING = (0.4, 0.7)
"""Narrower open parts of the map are not looked into at first [m]."""
_VISITS = (0, 4)
"""Places that are driven to again once nothing is open."""
_HEADING_ERROR = 0.25
"""The driver stops to turn at this error of the heading [rad]."""
_PATIENCE = 120.0
"""A driver who doesn't come nearer gives up after so long: slow, but with a view of the whole way [s]."""
_STRAIGHT = 0.05
"""Slower turns are no press of a key: the robot drives straight on [rad/s]."""


class _Driver(Pilot):
    """First to what is open, then through the building again."""

    def __init__(self, context: ExplorerContext, rng: np.random.Generator) -> None:
        speed = rng.uniform(*_SPEED)
        turn_rate = rng.uniform(*_TURN_RATE)
        opening = rng.uniform(*_OPENING)
        self._visits_left = int(rng.integers(_VISITS[0], _VISITS[1] + 1))
        follower = FollowerConfig(turn_in_place=_HEADING_ERROR, turned=0.05, turn_rate=turn_rate)
        loop = ExplorationLoopConfig(
            min_frontier_size=opening,
            progress_timeout=_PATIENCE,
            navigator=NavigatorConfig(follower=follower, progress_time=_PATIENCE),
        )
        slow = replace(context, max_linear=min(speed, context.max_linear))
        self._rng = rng
        self._explorer = FrontierPilot(slow, loop, Nearest())
        self.loop = self._explorer.loop
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
        if command.linear > 0.0 and abs(command.angular) < _STRAIGHT:
            return Twist2D(command.linear, 0.0)
        return command

    def _with_floor(self, observation: Observation) -> ByteArray:
        """The map, with the floor that was seen where scans met nothing."""
        published: ByteArray = observation["map"]
        is_the_last = published is self._published and not published.flags.writeable
        if self._shown is not None and is_the_last:
            return self._shown
        self._note_floor(observation)
        frame = self._explorer.loop.context.frame
        shown = published.copy()
        cells = shown.reshape(frame.shape)
        cells[(cells == UNKNOWN) & ~self._unseen[::-1]] = FREE
        shown.flags.writeable = False
        self._published = published
        self._shown = shown
        return shown

    def _note_floor(self, observation: Observation) -> None:
        """Mark what lies before the scanner, where nothing returned, as seen."""
        context = self._explorer.loop.context
        laser = context.geometry
        frame = context.frame
        sensor = compose(Pose2D(*observation["pose"].tolist()), laser.mount)
        open_ranges = np.where(observation["scan"] >= laser.range_max, np.inf, 0.0)
        sweep(
            self._unseen,
            frame.origin_x,
            frame.origin_y,
            frame.resolution,
            sensor.x,
            sensor.y,
            sensor.theta,
            self._directions,
            open_ranges,
            _VIEW * laser.range_max,
        )

    def _visit(self) -> None:
        """Drive to some place that the robot can get to, or be content."""
        loop = self._explorer.loop
        navigator = loop.navigator
        navigator.cancel()
        costmap = navigator.costmap
        space = navigator.reachable
        if self._visits_left == 0 or costmap is None or space is None:
            self.finished = True
            return
        self._visits_left -= 1
        for _ in range(_TRIES):
            self.decisions += 1
            cell = int(space.order[self._rng.integers(space.num_centre)])
            row, col = divmod(cell, costmap.costs.shape[1])
            x, y = costmap.frame.to_point(row, col)
            navigator.set_goal(Goal(float(x), float(y)), loop.pose, loop.time)
            if navigator.is_active:
                return


class SimulatedOperator(BatchedExplorer):
    """A simulated person who drives by keyboard; each environment of a batch has its own driver.

    Args:
        context: What the environment says about the robot and its map.
        seed: Of the drivers' habits and of the places that they visit again.
    """

    def __init__(self, context: ExplorerContext, seed: int = 0) -> None:

        def begin(index: int) -> Pilot:
            return _Driver(context, np.random.default_rng([seed, index]))

        super().__init__(context, "simulated_operator", begin)
