"""Refuse a path that the robot can't have driven: the true trajectory must stay in the free space."""

import numpy as np
import shapely

from slamgym.core.errors import ConfigError
from slamgym.core.types import FloatArray


def check_path_is_free(
    points: FloatArray, free_space: shapely.Polygon, name: str, what: str = "waypoint"
) -> None:
    """Check every point and every straight piece of a path.

    Args:
        points: (M, 2) [m], the frame of the plan.
        free_space: Where a robot's centre can be.
        name: What to call the path in the error.
        what: What to call one point.

    Raises:
        ConfigError: If a point lies outside the plan or in a wall, or a piece leads through a wall.
    """
    shapely.prepare(free_space)
    inside = shapely.intersects_xy(free_space, points[:, 0], points[:, 1])
    if not inside.all():
        i = int(np.argmin(inside))
        x, y = points[i]
        min_x, min_y, max_x, max_y = free_space.bounds
        if not (min_x <= x <= max_x and min_y <= y <= max_y):
            raise ConfigError(
                f"{name}: {what} {i + 1} at ({x:.2f}, {y:.2f}) lies outside the plan, which spans "
                f"({min_x:.2f}, {min_y:.2f}) to ({max_x:.2f}, {max_y:.2f})"
            )
        raise ConfigError(
            f"{name}: {what} {i + 1} at ({x:.2f}, {y:.2f}) lies in a wall; move it to free space"
        )
    pieces = np.asarray(shapely.linestrings(np.stack([points[:-1], points[1:]], axis=1)))
    clear = shapely.covers(free_space, pieces)
    if not clear.all():
        i = int(np.argmin(clear))
        beyond = shapely.difference(pieces[i], free_space)
        x, y = shapely.get_coordinates(beyond)[0]
        raise ConfigError(
            f"{name}: the way from {what} {i + 1} to {i + 2} leads through a wall at ({x:.2f}, {y:.2f}); "
            "add a point that goes round it"
        )
