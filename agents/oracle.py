"""The oracle: what one who knows the floor plan would need at least, for each share of the floor.

No robot can explore like this: it is a bound that says how much is left to gain. It is made from an environment, never
by a name and a context, so that no explorer gets the truth unasked.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np

from slamgym.agents.coverage_tour import TourSearch, Viewpoints
from slamgym.core.types import OCCUPIED, UNKNOWN, OccupancyGrid, Pose2D
from slamgym.envs import ExploreEnv
from slamgym.envs.coverage import ReachableFloor
from slamgym.planning import CostmapConfig, crop_known, make_costmap, reachable_space
from slamgym.planning.frontiers import Point
from slamgym.sim import Clutter


def true_viewpoints(env: ExploreEnv, resolution: float = 0.05) -> Viewpoints:
    """Places in the building of a running episode, in the world frame. Privileged.

    Args:
        env: After its reset.
        resolution: Cells of the drawing on which tours are planned [m].
    """
    plan, clutter, robot, start = env.plan, env.clutter, env.config.robot, env.start
    offset = start.x, start.y
    frame = replace(env.config.observation, map_resolution=resolution).frame()
    drawn = plan.raster(resolution, frame=frame, offset=offset, outside=UNKNOWN)
    known = crop_known(_with_furniture(drawn, clutter, offset), Pose2D(0.0, 0.0, 0.0))
    frame = known.frame._replace(
        origin_x=known.frame.origin_x + offset[0], origin_y=known.frame.origin_y + offset[1]
    )
    config_of_body = CostmapConfig(inscribed_radius=robot.radius, inflation_radius=robot.radius)
    costmap = make_costmap(OccupancyGrid(known.cells, frame), config_of_body)
    space = reachable_space(costmap, start)
    assert space is not None, "the robot stands in the building"
    floor = ReachableFloor(plan, robot.radius, clutter.passages)
    return Viewpoints(
        costmap,
        space,
        floor.mask(start.x, start.y),
        floor.frame,
        np.vstack([plan.segments(), clutter.segments()]),
        env.config.usable_range,
    )


class Bound(NamedTuple):
    """Least path and time known to see a share of a building."""

    share: float
    path: float  # [m]
    time: float  # at top speed; at each stop the robot turns until it has looked all round [s]


def bound_exploration(
    env: ExploreEnv, shares: Sequence[float], seed: int = 0, iterations: int = 100
) -> list[Bound]:
    """The best tours known for some shares of the floor, one for each. Privileged.

    Nobody drives them: the robot is at top speed from stop to stop, turning on its way costs nothing, it knows where
    it is. At every stop it looks all round, on its way ahead. Only a real optimum would be a bound in the strict sense;
    the search comes near it.

    Args:
        env: An environment after its reset.
        shares: Of the floor to be seen, ascending.
        seed: Of the search.
        iterations: The budget: how often the tour for each share is taken apart and put together again.

    Returns:
        One for each share, in the same order; a larger share never takes less.
    """
    viewpoints = true_viewpoints(env, env.config.observation.map_resolution)
    start = (env.start.x, env.start.y)
    seen_first = viewpoints.views[viewpoints.nearest(start)]
    search = TourSearch(viewpoints, start, ~seen_first, np.random.default_rng(seed))
    robot, lidar = env.config.robot, env.config.lidar
    look = (
        max(0.0, 2.0 * math.pi - math.radians(lidar.field_of_view_deg)) / robot.max_angular
    )  # [s]
    found: list[Bound] = []
    tour: list[int] = []
    for share in shares:
        needed = round(share * seen_first.size) - int(np.count_nonzero(seen_first))
        tour = search.shortest(needed, iterations, tour)
        path = search.length(tour)
        found.append(Bound(share, path, path / robot.max_linear + len(tour) * look))
    return [
        Bound(one.share, min(more.path for more in found[i:]), min(more.time for more in found[i:]))
        for i, one in enumerate(found)
    ]


def _with_furniture(grid: OccupancyGrid, clutter: Clutter, offset: Point) -> OccupancyGrid:
    """A drawing with the furniture in it; ``offset`` is where its origin lies in the world [m]."""
    cells = grid.cells.copy()
    for solid in clutter.solids():
        corners = solid - offset
        row, col = grid.frame.to_cell(corners[:, 0], corners[:, 1])
        cv2.fillPoly(cells, [np.column_stack([col, row]).astype(np.int32)], int(OCCUPIED))
    return OccupancyGrid(cells, grid.frame)
