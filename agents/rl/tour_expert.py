"""An expert to imitate: which frontier lies on a short tour that sees all that is left. Privileged.

It plans as :class:`slamgym.agents.oracle.FullKnowledge` does, with the floor plan and the true coverage, but
answers within the choice that the policy has: the frontier over which the way to the tour's first stop is
shortest.
"""

import numpy as np

from slamgym.agents.coverage_tour import SightPlanner
from slamgym.core.types import BoolArray, OccupancyGrid
from slamgym.envs.coverage import ReachableFloor
from slamgym.envs.explore_frontiers_env import ExploreFrontiersEnv
from slamgym.planning import Costmap, CostmapConfig, make_costmap, reachable_space
from slamgym.planning.coarse_paths import CoarsePaths


class TourExpert:
    """Knows the building of one environment's running episode.

    Args:
        env: After its reset; there has to be a new expert for every episode.
    """

    def __init__(self, env: ExploreFrontiersEnv) -> None:
        inner = env.inner
        self._env = env
        plan, start = inner.plan, inner.start
        costmap = _true_costmap(env)
        space = reachable_space(costmap, start)
        assert space is not None, "the robot stands in the building"
        floor = ReachableFloor(plan, inner.config.robot.radius, inner.clutter.furniture)
        segments = np.vstack([plan.segments(), inner.clutter.segments()])
        self._planner = SightPlanner(
            costmap, space, floor.mask(start.x, start.y), floor.frame, segments, inner.config.usable_range
        )
        self._paths = CoarsePaths(costmap, space)

    @property
    def unseen(self) -> BoolArray:
        """Which of the planner's cells have truly not been seen."""
        seen = self._env.inner.coverage.seen[::-1].reshape(-1)[self._planner.cells]
        unseen: BoolArray = self._planner.coverable & ~seen
        return unseen

    def choose(self) -> int:
        """The index of a candidate."""
        driver, origin = self._env.driver, self._env.inner.start
        if len(driver.candidates) < 2:
            return 0
        here = driver.pose.x + origin.x, driver.pose.y + origin.y
        tour = self._planner.plan(self.unseen, here)
        if not tour:
            return 0
        from_stop = self._paths.lengths_from(self._paths.place(tour[0].point))
        ends = np.array([candidate.path[-1] for candidate in driver.candidates]) + np.array(
            [origin.x, origin.y]
        )
        onward = np.array([self._onward(from_stop, (float(x), float(y))) for x, y in ends])
        ways = np.array([candidate.path_length for candidate in driver.candidates])
        return int(np.argmin(ways + onward))

    def _onward(self, from_stop: np.ndarray, point: tuple[float, float]) -> float:
        place = self._paths.place(point)
        return float(from_stop[place]) if place >= 0 else np.inf


def _true_costmap(env: ExploreFrontiersEnv) -> Costmap:
    """The true building with the robot's body, world frame."""
    plan, radius = env.inner.plan, env.inner.config.robot.circumscribed_radius
    drawn = plan.raster(0.05)
    return make_costmap(
        OccupancyGrid(drawn.cells, drawn.frame),
        CostmapConfig(inscribed_radius=radius, inflation_radius=radius),
    )
