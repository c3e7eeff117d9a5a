import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgym.core.geometry import wrap_angle
from slamgym.core.jit import plain
from slamgym.core.types import (
    FREE,
    OCCUPIED,
    GridFrame,
    LaserGeometry,
    OccupancyGrid,
    Pose2D,
    Twist2D,
)
from slamgym.planning import Goal, GoalStatus, Navigator, PathFollower, make_costmap
from slamgym.planning.context import ExplorerContext
from slamgym.planning.goal_progress import GoalProgress
from slamgym.planning.path_follower import free_travel, scan_points
from slamgym.planning.unmapped import MapCorrections


def room(rows=80, cols=120):
    cells = np.full((rows, cols), FREE)
    cells[[0, -1]] = OCCUPIED
    cells[:, [0, -1]] = OCCUPIED
    return cells


def drive_to(world, goal, seconds=120.0, known=True, stuck=False):
    """Run the navigation stack until the goal ends; returns it and the commands."""
    navigator, commands = Navigator(world.context), []
    grid = world.truth if known else OccupancyGrid(world.map, world.truth.frame)
    world.scan()
    navigator.update_map(grid, world.pose, 0.0)
    navigator.set_goal(goal, world.pose, 0.0)
    for step in range(int(seconds / world.context.control_step)):
        time = step * world.context.control_step
        if step % 10 == 0 and not known:
            navigator.update_map(
                OccupancyGrid(world.map.copy(), world.truth.frame), world.pose, time
            )
        if not navigator.is_active:
            break
        command = navigator.step(world.pose, world.scan(), time)
        commands.append(command)
        if not stuck:
            world.drive(command)
    return navigator, np.array(commands).reshape(-1, 2)


@settings(max_examples=8)
@given(row=st.integers(8, 70), col=st.integers(8, 110), theta=st.floats(-3.1, 3.1))
def test_goals_in_a_room_are_reached_within_the_limits_of_the_robot(make_world, row, col, theta):
    cells = room()
    cells[30:50, 55:60] = OCCUPIED
    if (cells[row - 6 : row + 7, col - 6 : col + 7] == OCCUPIED).any():
        return
    world = make_world(cells)
    world.place(20, 20, theta)
    goal = world.point(row, col)
    navigator, commands = drive_to(world, Goal(*goal))
    assert navigator.status is GoalStatus.SUCCEEDED
    assert math.dist(world.pose[:2], goal) < 0.3
    assert world.contacts == 0
    if len(commands):
        assert np.abs(commands[:, 0]).max() <= world.context.max_linear + 1e-9
        assert np.abs(commands[:, 1]).max() <= world.context.max_angular + 1e-9


def test_a_door_of_70_cm_is_driven_through_without_contact(make_world):
    cells = room()
    cells[:, 58:61] = OCCUPIED
    cells[30:44, 58:61] = FREE
    world = make_world(cells)
    world.place(12, 20)
    navigator, _ = drive_to(world, Goal(*world.point(65, 100)))
    assert navigator.status is GoalStatus.SUCCEEDED
    assert world.contacts == 0


def test_the_robot_ends_up_looking_at_its_goal(make_world):
    world = make_world(room())
    world.place(40, 30)
    behind = world.point(40, 5)
    drive_to(world, Goal(*world.point(40, 50), look_at=behind))
    bearing = math.atan2(behind[1] - world.pose.y, behind[0] - world.pose.x)
    assert abs(wrap_angle(bearing - world.pose.theta)) < 0.3


def test_an_unreachable_goal_aborts_at_once(make_world):
    cells = room()
    cells[:, 60] = OCCUPIED
    world = make_world(cells)
    world.place(40, 30)
    navigator, commands = drive_to(world, Goal(*world.point(40, 100)))
    assert navigator.status is GoalStatus.ABORTED
    assert navigator.reason == "unreachable"
    assert len(commands) == 0


def test_a_robot_that_does_not_move_recovers_and_then_gives_up(make_world):
    world = make_world(room())
    world.place(40, 30)
    navigator, commands = drive_to(world, Goal(*world.point(40, 100)), stuck=True)
    assert navigator.status is GoalStatus.ABORTED
    assert navigator.reason == "stuck"
    assert (commands[:, 0] < 0).any()  # backed up
    assert ((commands[:, 0] == 0) & (commands[:, 1] != 0)).any()  # turned
    assert len(commands) * world.context.control_step < 60.0


@pytest.mark.parametrize(("pose", "is_stuck"), [
    (Pose2D(0.05, 0.0, 0.05 - math.pi), True),
    (Pose2D(0.2, 0.0, math.pi - 0.05), False),
    (Pose2D(0.0, 0.0, 0.4 - math.pi), False),
    (Pose2D(0.0, 0.0, math.pi - 0.5), False),
])  # fmt: skip
def test_a_robot_stands_still_that_errs_a_little_across_half_a_turn(pose, is_stuck):
    progress = GoalProgress.begin(Pose2D(0.0, 0.0, math.pi - 0.05), 0.0)
    progress.note_pose(pose, 3.0)
    assert progress.is_stuck(5.0, 25.0) is is_stuck


def test_a_passage_that_the_robot_did_not_get_through_is_closed_from_then_on(make_world):
    cells = room()
    cells[:, 60] = OCCUPIED
    cells[27:53, 60] = FREE  # as a map shows a pane of glass
    world = make_world(cells)
    world.place(40, 54)
    beyond = Goal(*world.point(40, 100))
    navigator, _ = drive_to(world, beyond, stuck=True)
    assert navigator.reason == "stuck"
    row, col = navigator.costmap.frame.to_cell(beyond.x, beyond.y)
    mask = navigator.reachable.mask.reshape(navigator.costmap.costs.shape)
    assert mask[row, col]
    navigator.block_ahead(world.pose, 60.0)
    assert navigator.reachable.mask.reshape(navigator.costmap.costs.shape)[row, col]  # one more try
    navigator.block_ahead(world.pose, 60.0)
    mask = navigator.reachable.mask.reshape(navigator.costmap.costs.shape)
    assert not mask[row, col]
    navigator.set_goal(beyond, world.pose, 60.0)
    assert navigator.reason == "unreachable"
    navigator.set_goal(Goal(*world.point(40, 20)), world.pose, 60.0)
    assert navigator.is_active


@pytest.mark.parametrize(
    "pane", [slice(27, 53), slice(37, 44)]
)  # wider and narrower than the robot
def test_what_the_map_showed_where_a_goal_was_given_up_stays_closed(make_world, pane):
    cells = room()
    cells[:, 60] = OCCUPIED
    world = make_world(cells)
    world.place(40, 54)
    navigator = Navigator(world.context)
    beyond = Goal(*world.point(40, 100))
    looked_through = world.truth.cells.copy()
    looked_through[pane, 60] = FREE

    def is_open(cells):
        navigator.update_map(OccupancyGrid(cells, world.truth.frame), world.pose, 100.0)
        navigator.set_inscribed_radius(0.13, world.pose, 100.0)
        navigator.set_goal(beyond, world.pose, 100.0)
        return navigator.is_active

    assert is_open(looked_through)
    assert not is_open(world.truth.cells)  # from straight ahead the pane is seen
    assert is_open(looked_through)
    assert not is_open(world.truth.cells)
    navigator.keep_obstacles(world.pose, 100.0)
    assert not is_open(looked_through)
    navigator.set_goal(Goal(*world.point(40, 20)), world.pose, 100.0)
    assert navigator.is_active


def test_what_only_the_scan_showed_is_kept_as_a_wall_across_its_line_of_sight(make_world):
    cells = room()
    cells[:, 60] = OCCUPIED
    cells[30:50, 60] = FREE
    corrections = MapCorrections(spacing=0.025)
    world = make_world(cells)
    world.place(40, 54)
    corrections.note_seen(np.array([world.point(40, 60)]), world.pose, 0.0)
    marked = corrections.mark(world.truth, 5.0).cells
    assert (marked == OCCUPIED).sum() == (cells == OCCUPIED).sum() + 1
    corrections.keep_around(world.pose, 0.22, make_costmap(world.truth), world.truth)
    kept = corrections.mark(world.truth, 50.0).cells
    assert np.all(kept[31:49, 60] == OCCUPIED)
    assert np.all(kept[:, 59] == cells[:, 59])


@pytest.mark.parametrize("bearing", [0.0, 0.8, 2.0, -2.5])
def test_a_wall_across_the_line_of_sight_stands_at_right_angles_to_it(bearing):
    ahead, here = np.array([math.cos(bearing), math.sin(bearing)]), np.array([1.0, 2.0])
    seen = (here + 1.5 * ahead)[None]
    wall = MapCorrections(spacing=0.025)._across_sight(seen, Pose2D(1.0, 2.0, 0.3)) - here
    np.testing.assert_allclose(wall @ ahead, 1.5, atol=1e-9)
    assert np.ptp(wall @ [-ahead[1], ahead[0]]) == pytest.approx(1.0, abs=0.03)


def test_what_only_the_scan_showed_is_forgotten_after_ten_seconds(make_world):
    corrections = MapCorrections(spacing=0.025)
    world = make_world(room())
    world.place(40, 54)
    corrections.note_seen(np.array([world.point(40, 60)]), world.pose, 3.0)
    for time, count in ((3.0, 1), (12.9, 1), (13.1, 0)):
        marked = corrections.mark(world.truth, time).cells
        assert np.count_nonzero(marked != world.truth.cells) == count


def test_something_new_in_the_way_is_driven_round(make_world):
    world = make_world(room())
    world.place(40, 20)
    known = world.truth
    appeared = room()
    appeared[34:47, 60:64] = OCCUPIED  # not in the map that the robot plans on
    blocked = make_world(appeared)
    blocked.place(40, 20)
    blocked.map[:] = known.cells
    navigator, _ = drive_to(blocked, Goal(*blocked.point(40, 100)), known=False)
    assert navigator.status is GoalStatus.SUCCEEDED
    assert blocked.contacts == 0


def test_a_blind_corner_with_someone_behind_it_stops_the_robot(make_world):
    cells = room()
    cells[:55, 58:61] = OCCUPIED
    someone = cells.copy()
    someone[45:50, 61:119] = OCCUPIED  # fills the passage behind the corner
    world = make_world(someone)
    world.place(20, 40)
    navigator = Navigator(world.context)
    navigator.update_map(make_world(cells).truth, world.pose, 0.0)
    navigator.set_goal(Goal(*world.point(20, 100)), world.pose, 0.0)
    for step in range(1000):
        if not navigator.is_active:
            break
        world.drive(navigator.step(world.pose, world.scan(), 0.2 * step))
    assert navigator.status is GoalStatus.ABORTED
    assert world.contacts == 0


def test_single_false_readings_are_no_obstacles():
    laser = LaserGeometry(180, -math.pi / 2, math.pi / 179, 0.12, 3.5)
    ranges = np.full(180, 3.5, np.float32)
    ranges[90] = 0.3
    ranges[20:23] = 1.0
    points = scan_points(ranges, plain(laser))
    np.testing.assert_allclose(np.hypot(*points.T), 1.0, atol=1e-6)
    assert len(points) == 3


@pytest.mark.parametrize("nan", [np.nan, np.inf, -np.inf])
def test_erroneous_readings_are_left_out(nan):
    ranges = np.full(10, nan, np.float32)
    assert len(scan_points(ranges, plain(LaserGeometry(10, 0.0, 0.1, 0.12, 3.5)))) == 0


def test_free_travel_is_the_time_to_contact():
    wall = np.array([[0.5, 0.0]])
    time = free_travel(wall, 0.26, 0.0, 0.25, 0.01)
    assert time == pytest.approx((0.5 - 0.25) / 0.26, abs=0.02)
    assert free_travel(wall, -0.26, 0.0, 0.25, 0.01) == 1.2  # the horizon
    # In contact already: away is free, nearer is not.
    touching = np.array([[0.22, 0.0]])
    assert free_travel(touching, 0.1, 0.0, 0.25, 0.1) == 0.0
    assert free_travel(touching, -0.1, 0.0, 0.25, 0.1) == 1.2


def test_a_turn_past_the_back_keeps_its_direction():
    context = ExplorerContext(
        frame=GridFrame(0.05, 0.0, 0.0, 100, 100),
        geometry=LaserGeometry(180, -math.pi / 2, math.pi / 179, 0.12, 3.5),
    )
    follower = PathFollower(context)
    costmap = make_costmap(OccupancyGrid(np.full((100, 100), FREE, np.uint8), context.frame))
    follower.set_path(np.column_stack([np.linspace(2.5, 0.5, 41), np.full(41, 2.5)]))
    signs = set()
    for wobble in (0.02, -0.02, 0.02, -0.02):
        command = follower.step(costmap, Pose2D(2.5, 2.5, wobble), np.zeros((0, 2)))
        assert command.linear == 0.0
        signs.add(np.sign(command.angular))
    assert len(signs) == 1


def test_points_of_a_scan_lie_where_the_mounted_scanner_sees_them():
    mount = Pose2D(0.1, -0.2, 0.5)
    points = scan_points(
        np.full(7, 1.5, np.float32), plain(LaserGeometry(7, -0.9, 0.3, 0.12, 3.5, mount))
    )
    angles = 0.5 - 0.9 + 0.3 * np.arange(7)
    expected = [0.1, -0.2] + 1.5 * np.column_stack([np.cos(angles), np.sin(angles)])
    np.testing.assert_allclose(points, expected, atol=1e-6)


def test_a_robot_that_something_slows_down_keeps_to_its_arc():
    context = ExplorerContext(
        frame=GridFrame(0.05, 0.0, 0.0, 100, 100),
        geometry=LaserGeometry(180, -math.pi / 2, math.pi / 179, 0.12, 3.5),
    )
    costmap = make_costmap(OccupancyGrid(np.full((100, 100), FREE, np.uint8), context.frame))
    follower = PathFollower(context)
    aside = np.linspace(0.0, 1.0, 41)
    follower.set_path(np.column_stack([2.5 + aside, 2.5 + 0.5 * aside]))

    def command(obstacles):
        return follower.step(costmap, Pose2D(2.5, 2.5, 0.0), np.array(obstacles).reshape(-1, 2))

    linear, angular = command([])
    before = 0.0
    for x in (0.4, 0.46, 0.52):
        slower = command([(x, 0.1)])
        assert before < slower.linear < 0.95 * linear  # the nearer, the slower
        assert slower.angular / slower.linear == pytest.approx(angular / linear)
        before = slower.linear


def test_normalised_and_physical_actions_are_the_same_velocity():
    context = ExplorerContext(GridFrame(0.05, 0, 0, 10, 10), LaserGeometry(2, 0, 1, 0.1, 3.5))
    np.testing.assert_allclose(context.to_action(Twist2D(0.13, -9.0)), [0.5, -1.0])
    physical = replace(context, normalized_actions=False)
    np.testing.assert_allclose(physical.to_action(Twist2D(0.13, -9.0)), [0.13, -1.82], rtol=1e-6)


def test_a_velocity_is_led_round_what_the_scan_shows():
    laser = LaserGeometry(180, -math.pi / 2, math.pi / 179, 0.12, 3.5, Pose2D(-0.03, 0.0, 0.0))
    follower = PathFollower(ExplorerContext(frame=GridFrame(0.05, 0.0, 0.0, 9, 9), geometry=laser))

    def led(command, distance, bearing):
        """Past a post at a distance of the robot's centre and a bearing."""
        x = distance * np.cos(bearing) - laser.mount.x
        y = distance * np.sin(bearing) - laser.mount.y
        is_post = np.abs(laser.angles - np.arctan2(y, x)) < 0.1
        ranges = np.where(is_post, np.hypot(x, y), np.inf).astype(np.float32)
        return follower.avoid(Twist2D(*command), ranges)

    assert led((0.2, 0.1), 1.5, 0.0) == (0.2, 0.1)  # far off
    round_it = led((0.2, 0.0), 0.45, 0.2)
    assert round_it.linear > 0.0 > round_it.angular
    for side in (1.0, -1.0):
        assert led((0.2, 0.0), 0.2, 0.5 * side) == (0.0, -side * follower.fastest_turn)
        assert led((0.2, 0.0), 0.2, 1.8 * side) == (0.2, 0.0)  # it has turned away
    assert led((-0.2, 0.3), 1.5, 0.0) == (0.0, 0.3)  # nothing is seen behind
