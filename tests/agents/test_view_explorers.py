"""What explorers by views decide on constructed maps."""

import math

import numpy as np
import pytest

from slamgym.agents.frontier_exploration import Candidate
from slamgym.agents.frontier_tour import FrontierTour, FrontierTourConfig, Repairman, RepairmanConfig
from slamgym.agents.next_best_view import NextBestView, NextBestViewConfig
from slamgym.agents.registry import make_explorer
from slamgym.core.errors import ConfigError
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, Pose2D
from slamgym.planning import Goal
from slamgym.planning.navigator import GoalStatus


def corridor(make_world, left, right):
    """A corridor of 10 m; its ends are unknown, as deep as said [cells], the robot 1.5 m left of the middle."""
    cells = np.full((30, 200), FREE)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    world = make_world(cells)
    world.map[:] = cells
    world.map[1:29, 1 : 1 + left] = UNKNOWN
    world.map[1:29, 199 - right : 199] = UNKNOWN
    world.map[:, 0] = world.map[:, -1] = OCCUPIED
    world.place(15, 70)
    return world


def first_target(explorer, world):
    """Column of the place that the explorer goes to first [cells]."""
    explorer.predict(world.observation(0.0))
    target = explorer._explorations[0]._target
    return int(world.truth.frame.to_cell(*target.target)[1])


def without_scan(world):
    """The world's observations leave the map as it is."""
    world.scan = lambda: np.full(180, 3.5, np.float32)
    return world


def test_the_next_best_view_prefers_gain_until_the_path_outweighs_it(make_world):
    # 3 m to the left a strip of 0.2 m is unknown, 4.5 m to the right one of 2 m.
    world = without_scan(corridor(make_world, left=4, right=40))
    for weight, side in ((0.1, "right"), (5.0, "left")):
        explorer = NextBestView(world.context, NextBestViewConfig(path_weight=weight))
        column = first_target(explorer, world)
        assert (column > 70) == (side == "right"), weight


def test_the_tour_turns_to_the_nearer_end_first_and_the_repairman_to_the_heavier(make_world):
    world = without_scan(corridor(make_world, left=4, right=40))
    no_turning = {"turn_weight": 0.0}
    assert first_target(FrontierTour(world.context, FrontierTourConfig(**no_turning)), world) < 70
    heavy = RepairmanConfig(area_weight=10.0, wait_weight=0.01, **no_turning)
    assert first_target(Repairman(world.context, heavy), world) > 70
    light = RepairmanConfig(area_weight=0.0, wait_weight=1.0, **no_turning)
    assert first_target(Repairman(world.context, light), world) < 70


def test_turning_round_counts_as_way(make_world):
    world = without_scan(corridor(make_world, left=20, right=60))
    # Alike far: 50 cells to the left, 69 to the right; the robot looks to the right.
    assert first_target(FrontierTour(world.context, FrontierTourConfig(turn_weight=0.0)), world) < 70
    assert first_target(FrontierTour(world.context, FrontierTourConfig(turn_weight=1.0)), world) > 70


@pytest.mark.parametrize("distance", [0.5, 1.5])
def test_a_frontier_is_looked_at_from_the_place_on_the_way_that_sees_it(make_world, distance):
    world = without_scan(corridor(make_world, left=0, right=40))
    explorer = FrontierTour(world.context, FrontierTourConfig(view_distance=distance))
    column = first_target(explorer, world)
    edge = 159
    assert 0.05 * (edge - column) <= distance + 0.1
    assert 0.05 * (edge - column) >= 0.6 * distance  # no farther than needed
    goal: Goal = explorer._explorations[0]._navigator.goal
    assert goal.look_at[0] > goal.x


def test_a_frontier_that_a_look_does_not_clear_is_visited_and_then_left(make_world):
    world = without_scan(corridor(make_world, left=0, right=40))
    explorer = FrontierTour(world.context, FrontierTourConfig(view_distance=1.5))
    looked_from = first_target(explorer, world)
    exploration = explorer._explorations[0]

    def reach(time):
        exploration._navigator.status = GoalStatus.SUCCEEDED
        x, y = exploration._target.target
        world.pose = Pose2D(x, y, 0.0)
        explorer.predict(world.observation(time))

    reach(2.0)
    visited: Candidate = exploration._target
    column = int(world.truth.frame.to_cell(*visited.target)[1])
    assert column > looked_from
    assert exploration._blacklist == []
    reach(4.0)
    assert len(exploration._blacklist) == 1


def test_a_way_round_a_wall_is_progress_though_the_goal_gets_no_nearer_in_a_straight_line(make_world):
    # The door is 4 m from goal and start, which are 1 m apart on either side of the wall.
    cells = np.full((40, 120), FREE)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    cells[19:21, :100] = OCCUPIED
    world = make_world(cells)
    world.map[:] = cells
    world.map[30:39, 1:15] = UNKNOWN
    world.place(10, 10)
    without_scan(world)
    explorer = make_explorer("nearest", world.context)
    for step in range(int(34.0 / world.context.control_step)):
        action, _ = explorer.predict(world.observation(0.2 * step))
        exploration = explorer._explorations[0]
        assert exploration._blacklist == []
        # At a fifth of the speed: after 30 s the robot is still on the way out.
        world.pose = Pose2D(
            world.pose.x + 0.2 * 0.2 * action[0] * world.context.max_linear * math.cos(world.pose.theta),
            world.pose.y + 0.2 * 0.2 * action[0] * world.context.max_linear * math.sin(world.pose.theta),
            math.remainder(world.pose.theta + 0.2 * action[1] * world.context.max_angular, 2 * math.pi),
        )


def test_more_frontiers_than_a_tour_holds_are_all_ordered(make_world):
    cells = np.full((40, 400), FREE)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    world = make_world(cells)
    world.map[:] = cells
    for column in range(10, 390, 30):
        world.map[0, column : column + 15] = UNKNOWN  # 13 gaps of 0.75 m in the wall
    world.place(20, 200)
    without_scan(world)
    for make in (FrontierTour, Repairman):
        explorer = make(world.context)
        explorer.predict(world.observation(0.0))
        exploration = explorer._explorations[0]
        candidates = exploration._candidates(world.pose)
        assert len(candidates) == 13
        ranked = exploration._rank(candidates)
        assert len({c.frontier.initial for c in ranked}) == 13
        # The nearest are toured first.
        distance = [abs(c.target[0] - world.pose.x) for c in ranked]
        assert max(distance[:9]) <= min(distance[9:]) + 1e-6


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: FrontierTourConfig(view_distance=0.0), "view_distance"),
        (lambda: FrontierTourConfig(max_places=0), "max_places"),
        (lambda: RepairmanConfig(max_places=12), r"max_places must be in \[1, 9\], not 12"),
        (lambda: RepairmanConfig(wait_weight=0.0), "wait_weight must be above 0"),
    ],
)
def test_senseless_settings_are_refused(make, match):
    with pytest.raises(ConfigError, match=match):
        make()
