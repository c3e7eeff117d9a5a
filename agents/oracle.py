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
    robot = env.config.robot
    body = CostmapConfig(inscribed_radius=robot.radius, inflation_radius=robot.radius)
    costmap = make_costmap(_true_map(env, resolution), body)
    space = reachable_space(costmap, env.start)
    assert space is not None, "the robot stands in the building"
    floor = ReachableFloor(env.plan, robot.radius, env.clutter.passages)
    return Viewpoints(
        costmap,
        space,
        floor.mask(env.start.x, env.start.y),
        floor.frame,
        np.vstack([env.plan.segments(), env.clutter.segments()]),
        env.config.usable_range,
    )


def _true_map(env: ExploreEnv, resolution: float) -> OccupancyGrid:
    """The known part of a drawing of the building with its furniture, world frame."""
    offset = (env.start.x, env.start.y)
    canvas = replace(env.config.observation, map_resolution=resolution).frame()
    drawn = env.plan.raster(resolution, frame=canvas, offset=offset, outside=UNKNOWN)
    known = crop_known(_with_furniture(drawn, env.clutter, offset), Pose2D(0.0, 0.0, 0.0))
    frame = known.frame
    frame = frame._replace(origin_x=frame.origin_x + offset[0], origin_y=frame.origin_y + offset[1])
    return OccupancyGrid(known.cells, frame)


class Bound(NamedTuple):
    """Least path and time known to see a share of a building."""

    share: float
    """Of the floor."""
    path: float
    """[m]"""
    time: float
    """At top speed; at each stop the robot turns until it has looked all round [s]."""


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
    top_speed = env.config.robot.max_linear
    look = _time_of_a_look(env)
    found: list[Bound] = []
    tour: list[int] = []
    for share in shares:
        needed = round(share * seen_first.size) - int(np.count_nonzero(seen_first))
        tour = search.shortest(needed, iterations, tour)
        path = search.length(tour)
        found.append(Bound(share, path, path / top_speed + len(tour) * look))
    return _never_less(found)


def _time_of_a_look(env: ExploreEnv) -> float:
    """How long the robot turns at a stop until it has looked all round [s]."""
    out_of_sight = 2.0 * math.pi - math.radians(env.config.lidar.field_of_view_deg)
    return max(0.0, out_of_sight) / env.config.robot.max_angular


def _never_less(bounds: list[Bound]) -> list[Bound]:
    """Bounds of ascending shares, of which a larger one takes no less than those before."""
    found = []
    for index, bound in enumerate(bounds):
        path = min(more.path for more in bounds[index:])
        time = min(more.time for more in bounds[index:])
        found.append(Bound(bound.share, path, time))
    return found


def _with_furniture(grid: OccupancyGrid, clutter: Clutter, offset: Point) -> OccupancyGrid:
    """A drawing with the furniture in it; ``offset`` is where its origin lies in the world [m]."""
    cells = grid.cells.copy()
    for solid in clutter.solids():
        corners = solid - offset
        row, col = grid.frame.to_cell(corners[:, 0], corners[:, 1])
        cv2.fillPoly(cells, [np.column_stack([col, row]).astype(np.int32)], int(OCCUPIED))
    return OccupancyGrid(cells, grid.frame)
