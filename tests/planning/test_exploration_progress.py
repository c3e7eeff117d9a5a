"""Whether a robot comes nearer to its target, and whether it is cut off from where it was."""

import numpy as np
import pytest

from slamgym.core.types import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    GridFrame,
    LaserGeometry,
    OccupancyGrid,
    Pose2D,
)
from slamgym.planning import CostmapConfig, ExplorerContext, make_costmap, reachable_space
from slamgym.planning.exploration_progress import TargetProgress, Trail
from slamgym.planning.navigator import Navigator

FRAME = GridFrame(0.05, -3.0, -3.0, 120, 120)
EAST = Pose2D(1.5, 0.0, 0.0)


def two_rooms(door):
    """A room of 5 x 4 m in two halves, with a door of some width between them [m]."""
    cells = np.full(FRAME.shape, UNKNOWN, np.uint8)
    x, y = FRAME.to_point(*np.indices(FRAME.shape))
    inside = (np.abs(x) < 2.5) & (np.abs(y) < 2.0)
    cells[inside] = FREE
    cells[inside & ((np.abs(x) > 2.4) | (np.abs(y) > 1.9))] = OCCUPIED
    cells[inside & (np.abs(x) < 0.05) & (np.abs(y) > 0.5 * door)] = OCCUPIED
    return OccupancyGrid(cells, FRAME)


@pytest.mark.parametrize(("door", "is_cut_off"), [(0.9, False), (0.3, True)])
def test_a_robot_is_cut_off_if_the_door_that_it_came_through_is_drawn_narrow(door, is_cut_off):
    trail = Trail()
    for y in np.arange(-1.5, 0.0, 0.02):
        trail.note(Pose2D(-1.5, float(y), 0.0))
    for x in np.arange(-1.5, 1.5, 0.02):
        trail.note(Pose2D(float(x), 0.0, 0.0))
    assert len(trail.places) == 9, "a place each half metre"
    costmap = make_costmap(two_rooms(door), CostmapConfig(0.22))
    assert trail.is_cut_off(costmap, reachable_space(costmap, EAST)) == is_cut_off


def test_a_place_that_a_corrected_map_shows_in_a_wall_is_no_part_of_the_house():
    trail = Trail([(1.5, 0.0), (1.5, 2.8), (1.4, 0.0)])
    costmap = make_costmap(two_rooms(0.9), CostmapConfig(0.22))
    assert not trail.is_cut_off(costmap, reachable_space(costmap, EAST))


def test_who_drives_round_a_wall_comes_nearer_though_not_as_the_crow_flies():
    geometry = LaserGeometry(180, -np.pi / 2, np.pi / 179, 0.12, 3.5)
    navigator = Navigator(ExplorerContext(FRAME, geometry))
    path = np.array([(0.0, 0.1 * k) for k in range(41)] + [(0.1 * k, 4.0) for k in range(1, 41)])
    target = (2.0, 0.0)
    progress = TargetProgress()
    navigator.follower.set_path(path)
    for k in range(40):  # away from the target, to the wall's end
        waited = progress.waited(target, navigator, Pose2D(0.0, 0.1 * k, 0.0), float(k))
        navigator.follower.set_path(path[k + 1 :])
    assert waited <= 1.0
    for k in range(5):
        waited = progress.waited(target, navigator, Pose2D(0.0, 3.9, 0.0), 40.0 + k)
    assert waited >= 4.0, "it stands"
