"""What the explorer node decides, on maps of a stub mapper and with a navigation that aborts.

Tests that name an issue reproduce what users of explore_lite report (m-explore, m-explore-ros2).
"""

import math

import numpy as np
import pytest

from slamgym.core.errors import ConfigError
from slamgym.core.types import UNKNOWN, LaserGeometry, LaserScan, Pose2D, Twist2D
from slamgym.ros2.exploration import Exploration, ExplorationState
from slamgym.ros2.foreign_maps import LATTICE_CELL, ForeignMap
from slamgym.ros2.inputs import fit_ranges
from slamgym.ros2.parameters import ExploreParameters

STOP = Twist2D(0.0, 0.0)
WAITING, EXPLORING, PAUSED = (
    ExplorationState.WAITING,
    ExplorationState.EXPLORING,
    ExplorationState.PAUSED,
)
RETURNING, DONE, BLOCKED = (
    ExplorationState.RETURNING,
    ExplorationState.DONE,
    ExplorationState.BLOCKED,
)


def goals_at(robot, x_above):
    """Times of the goals beyond a line."""
    return [time for time, goal in robot.goals if goal.x > x_above]


# Exploring.


@pytest.mark.parametrize("explorer", ["tour", "explore_lite", "nearest", "rl", "tour@98%:95%"])
def test_every_explorer_of_frontiers_explores_a_map_that_grows(stub_robot, explorer):
    robot = stub_robot(explorer=explorer).run()
    assert robot.states == [EXPLORING, DONE]
    assert robot.seen_share() > (0.95 if "@" in explorer else 0.99)
    assert robot.exploration.text.startswith("done: ")


@pytest.mark.parametrize("explorer", ["wheels", "random", "simulated_operator"])
def test_explorers_without_frontiers_are_refused(explorer):
    with pytest.raises(
        ConfigError, match=f"the explorer {explorer} doesn't choose frontiers; take one that does"
    ):
        Exploration(ExploreParameters(explorer=explorer))


def test_it_drives_itself_within_the_limits_of_the_robot(stub_robot):
    robot = stub_robot(drive="wheels", max_linear=0.4, max_angular=1.0)
    for _ in range(100):
        order = robot.step()
        linear, angular = order.twist
        assert -0.4 <= linear <= 0.4
        assert abs(angular) <= 1.0
        x, y, theta = robot.pose
        for _ in range(5):
            theta += 0.1 * angular
            x, y = x + 0.1 * linear * math.cos(theta), y + 0.1 * linear * math.sin(theta)
        robot.pose = Pose2D(x, y, theta)
        assert order.goal is None
    assert robot.seen_share() > 0.6


def test_viewers_see_frontiers_the_chosen_one_and_the_way_there(stub_robot):
    robot = stub_robot()
    robot.step()
    view = robot.exploration.view()
    assert len(view.frontiers) >= 2
    assert any(np.array_equal(view.chosen, one) for one in view.frontiers)
    assert math.dist(view.path[-1], view.goal) < 0.7
    assert view.known_area > 10.0
    assert (
        robot.exploration.text
        == f"exploring: {len(view.frontiers)} frontiers, {view.known_area:.0f} m2 known"
    )


def test_the_area_limits_where_it_explores(stub_robot):
    robot = stub_robot(area=(-1.0, -1.0, 4.2, -1.0, 4.2, 6.0, -1.0, 6.0)).run()
    assert robot.state is DONE
    assert not goals_at(robot, 4.6)
    assert robot.seen_share() < 0.75
    with pytest.raises(ConfigError, match="three corners or more, not 4"):
        ExploreParameters(area=(0.0, 0.0, 1.0, 1.0))


# Navigation that aborts.


def test_navigation_that_starts_late_blocks_and_the_rest_is_explored(stub_robot):
    """Goals that move_base aborts at first are not given up for ever (m-explore #6, #26)."""
    robot = stub_robot(aborts=lambda time, goal: time < 40.0).run()
    assert robot.states == [EXPLORING, BLOCKED, EXPLORING, DONE]
    assert robot.seen_share() > 0.99
    assert "places not reached" not in robot.exploration.text


def test_each_goal_that_is_aborted_once_is_tried_again(stub_robot):
    """All frontiers are blacklisted one after the other, and then reached (m-explore #52)."""
    tried = []

    def aborts(time, goal):
        is_new = all(math.dist(goal[:2], other) > 0.4 for other in tried)
        tried.append(goal[:2])
        return is_new

    robot = stub_robot(aborts=aborts).run()
    assert robot.state is DONE
    assert robot.seen_share() > 0.99


def test_navigation_that_reaches_nothing_is_said_and_tried_every_minute(stub_robot):
    """ "All frontiers traversed/tried out, stopping" is never said at once (m-explore #26)."""
    robot = stub_robot(aborts=lambda time, goal: True).run(seconds=300.0)
    assert robot.states == [EXPLORING, BLOCKED]
    assert any(text.startswith("blocked: no place was reached") for text in robot.texts)
    times = np.array([time for time, _ in robot.goals])
    assert np.diff(times).max() <= 70.0
    assert np.count_nonzero(np.diff(times) > 50.0) >= 1
    assert robot.pose == Pose2D(2.0, 2.0, 0.0)


def test_a_place_that_fails_again_and_again_is_unreachable(stub_robot):
    robot = stub_robot(aborts=lambda time, goal: goal.x > 4.2).run()
    assert robot.states == [EXPLORING, DONE]
    assert robot.exploration.text.endswith("places not reached: 1")
    assert len(robot.exploration.unreached()) == 1
    times = goals_at(robot, 4.2)
    assert len(times) >= 4
    assert times[-1] - times[0] > 15.0


def test_it_does_not_stop_where_navigation_breaks_down_for_minutes(stub_robot):
    robot = stub_robot(aborts=lambda time, goal: 4.0 < time < 300.0).run(seconds=500.0)
    assert BLOCKED in robot.states
    assert robot.state is DONE
    assert robot.seen_share() > 0.99


def test_arrival_is_noticed_without_a_result(stub_robot):
    """Navigation succeeds, then the exploration hangs (m-explore-ros2 #36)."""
    robot = stub_robot()
    end, robot.exploration.goal_ended = robot.exploration.goal_ended, lambda number, reached: None
    robot.run()
    assert robot.state is DONE
    assert robot.seen_share() > 0.99
    end(robot.number, reached=False)  # late, and passed over


def test_results_of_older_goals_are_passed_over(stub_robot):
    robot = stub_robot()
    first = robot.step()
    while robot.number == first.number:
        robot.step()
    robot.exploration.goal_ended(first.number, reached=False)
    robot.run()
    assert robot.state is DONE
    assert "places not reached" not in robot.exploration.text


# First maps.


def test_a_first_map_that_shows_nothing_is_waited_for():
    """Exploration stops before the first map has any frontier (m-explore #52, m-explore-ros2 #35)."""
    exploration, maps = (
        Exploration(ExploreParameters(drive="goals", explorer="tour")),
        ForeignMap("/map"),
    )
    here = Pose2D(1.0, 1.0, 0.0)
    exploration.step(here, None, 0.0)
    assert (exploration.state, exploration.text) == (WAITING, "waiting for a map")
    exploration.take_map(
        maps.take(np.full(1600, -1, np.int8), 40, 40, LATTICE_CELL, Pose2D(0.0, 0.0, 0.0))
    )
    exploration.step(here, None, 0.2)
    assert exploration.text == "waiting for a map that shows anything"
    exploration.step(Pose2D(9.0, 1.0, 0.0), None, 0.4)
    assert exploration.state is WAITING


def lonely(free):
    """A map of 8 x 8 m of which only a box (first row, end row, first col, end col) is free."""
    values = np.full((160, 160), -1, np.int8)
    values[free[0] : free[1], free[2] : free[3]] = 0
    return ForeignMap("/map").take(values, 160, 160, LATTICE_CELL, Pose2D(0.0, 0.0, 0.0))


def test_a_robot_on_an_unknown_cell_is_never_done():
    """The search fails where the robot stands on no free cell (m-explore #68)."""
    exploration = Exploration(ExploreParameters(drive="goals", explorer="tour"))
    exploration.take_map(lonely((120, 140, 120, 140)))
    for step in range(2000):
        order = exploration.step(Pose2D(2.0, 2.0, 0.0), None, 0.5 * step)
        if order.goal is not None:
            exploration.goal_ended(order.number, reached=True)
        assert exploration.state is not DONE
    exploration.take_map(lonely((20, 140, 20, 140)))
    for step in range(2000, 2140):
        order = exploration.step(Pose2D(2.0, 2.0, 0.0), None, 0.5 * step)
    assert exploration.state is not DONE
    assert exploration.view().frontiers


def test_a_robot_beside_a_wall_finds_its_frontiers(stub_robot):
    """The search fails where the robot stands on an inflated cell (m-explore #68)."""
    robot = stub_robot()
    robot.pose = Pose2D(0.25, 2.0, 0.0)
    assert robot.step().goal is not None
    robot.run()
    assert robot.seen_share() > 0.99


def test_frontiers_on_the_border_of_the_map_count():
    """Exploration ends early where free space meets the border of the map (m-explore #55)."""
    exploration, maps = (
        Exploration(ExploreParameters(drive="goals", explorer="tour")),
        ForeignMap("/map"),
    )
    exploration.take_map(
        maps.take(np.zeros(3600, np.int8), 60, 60, LATTICE_CELL, Pose2D(0.0, 0.0, 0.0))
    )
    order = exploration.step(Pose2D(1.5, 1.5, 0.0), None, 0.0)
    assert order.goal is not None
    assert exploration.view().frontiers


def test_a_closed_room_is_done_after_some_waiting():
    values = np.zeros((60, 60), np.int8)
    values[:2] = values[-2:] = values[:, :2] = values[:, -2:] = 100
    exploration, maps = (
        Exploration(ExploreParameters(drive="goals", explorer="tour")),
        ForeignMap("/map"),
    )
    exploration.take_map(maps.take(values, 60, 60, LATTICE_CELL, Pose2D(0.0, 0.0, 0.0)))
    stamps = np.arange(0.0, 300.0, 0.5)
    for stamp in stamps:
        exploration.step(Pose2D(1.5, 1.5, 0.0), None, stamp)
        if exploration.state is DONE:
            break
    assert exploration.state is DONE
    assert stamp > 10.0


# Pausing and returning.


def test_a_pause_cancels_the_goal_and_resuming_sends_it_again(stub_robot):
    """Start and stop while driving (m-explore-ros2 #7)."""
    robot = stub_robot()
    driving = robot.step()
    robot.exploration.pause()
    for _ in range(200):
        order = robot.step()
        assert (order.twist, order.goal) == (STOP, None)
        assert order.number != driving.number
        assert robot.state is PAUSED
    robot.exploration.resume()
    again = robot.step()
    assert again.goal is not None
    assert again.number > order.number
    robot.run()
    assert robot.seen_share() > 0.99


def test_after_the_end_it_can_be_resumed(stub_robot):
    """Exploration goes on where the map has changed since (m-explore-ros2 #33)."""
    robot = stub_robot().run()
    robot.known[:, 60:] = UNKNOWN
    robot.pose = Pose2D(2.0, 2.0, 0.0)
    robot.exploration.resume()
    robot.publish()
    robot.step()
    assert robot.state is EXPLORING
    robot.run()
    assert robot.seen_share() > 0.99


def test_it_returns_to_the_start(stub_robot):
    robot = stub_robot(return_to_start=True).run()
    assert robot.states == [EXPLORING, RETURNING, DONE]
    assert math.dist(robot.pose[:2], (2.0, 2.0)) < 0.3
    assert robot.exploration.text.endswith("; at the start")


def test_it_returns_when_told_and_is_paused_then(stub_robot):
    robot = stub_robot()
    for _ in range(8):
        robot.step()
    robot.exploration.return_to_start()
    robot.run(until=PAUSED)
    assert robot.exploration.text == "paused; at the start"
    robot.exploration.resume()
    robot.run()
    assert robot.seen_share() > 0.99


def test_it_returns_to_the_place_nearest_to_a_start_that_the_map_moved(stub_robot):
    """The start lies in a wall of the corrected map (m-explore-ros2 #36)."""
    robot = stub_robot(return_to_start=True)
    robot.step()
    robot.exploration.start = Pose2D(-1.5, 2.0, 0.0)
    robot.run()
    assert robot.state is DONE
    assert robot.pose.x < 0.6
    assert "m from the start" in robot.exploration.text


def test_an_aborted_return_is_tried_again_and_then_said(stub_robot):
    """The return is skipped (m-explore-ros2 #36)."""
    aborted = []

    def aborts(time, goal):
        is_return = time > 10.0 and math.dist(goal[:2], (2.0, 2.0)) < 0.3 and len(aborted) < most
        aborted.extend([goal] if is_return else [])
        return is_return

    for most, end in ((1, "; at the start"), (99, "; the start could not be reached")):
        aborted.clear()
        robot = stub_robot(aborts=aborts, return_to_start=True).run()
        assert robot.state is DONE
        assert robot.exploration.text.endswith(end)
        assert len(aborted) == min(most, 5)


# Bad input.


def test_what_is_no_number_is_passed_over(stub_robot):
    robot = stub_robot(drive="wheels")
    robot.step()
    order = robot.step(pose=Pose2D(math.nan, 0.0, 0.0))
    assert (order.twist, robot.state) == (STOP, WAITING)
    assert robot.step(pose=None).twist == STOP
    assert robot.exploration.text == "waiting for the robot's pose on the map"
    assert robot.step(scan=None).twist == STOP
    assert robot.exploration.text == "waiting for a scan"
    scan = robot.look()
    robot.step(scan=LaserScan(0.0, np.full(180, np.nan, np.float32), scan.geometry))
    robot.step(scan=LaserScan(0.0, scan.ranges[:77], scan.geometry), stamp=math.nan)
    assert robot.state is EXPLORING


def test_a_pose_outside_the_map_is_said(stub_robot):
    robot = stub_robot()
    robot.step()
    robot.step(pose=Pose2D(40.0, -7.0, 0.0))
    assert robot.exploration.text == "waiting for a map of where the robot is, (40.0, -7.0) m"


def test_a_goal_outlives_a_missing_transform(stub_robot):
    robot = stub_robot(aborts=lambda time, goal: False)
    driving = robot.step()
    late = robot.exploration.step(None, None, 1.7e9 + 1.0)
    assert (late.goal, late.number, late.twist) == (driving.goal, driving.number, STOP)
    assert robot.exploration.step(None, None, 1.7e9 + 4.0).goal is None


def test_a_clock_that_jumps_back_begins_again(stub_robot):
    robot = stub_robot()
    for _ in range(12):
        robot.step()
    robot.step(stamp=3.0)
    assert (
        robot.exploration.start == robot.pose
        or math.dist(robot.exploration.start[:2], robot.pose[:2]) < 1.0
    )
    robot.time = 5.0 - 1.7e9
    robot.run()
    assert robot.state is DONE
    assert robot.seen_share() > 0.99


def test_a_clock_that_jumps_ahead_changes_nothing(stub_robot):
    robot = stub_robot()
    first = robot.step()
    order = robot.step(stamp=1.7e9 + 86400.0)
    assert order.goal == first.goal
    robot.time += 86400.0
    robot.run()
    assert robot.states == [EXPLORING, DONE]


def test_scans_of_other_beams_are_fitted():
    own = LaserGeometry(4, -math.pi, 0.5 * math.pi, 0.1, 3.5)  # back, right, ahead, left
    other = LaserGeometry(
        8, 0.0, 0.25 * math.pi, 0.1, 10.0
    )  # ahead, ..., left, ..., back, ..., right, ...
    ranges = np.array([1.0, 9.0, 2.0, 9.0, np.inf, 9.0, np.nan, 9.0], np.float32)
    fitted = fit_ranges(LaserScan(0.0, ranges, other), own)
    np.testing.assert_array_equal(fitted, np.array([3.5, 0.0, 1.0, 2.0], np.float32))
    half = fit_ranges(LaserScan(0.0, ranges[:3], other), own)
    np.testing.assert_array_equal(half, np.array([0.0, 0.0, 1.0, 2.0], np.float32))
    assert len(fit_ranges(None, own)) == 0


@pytest.mark.parametrize("drive", ["goals", "wheels"])
def test_nothing_that_comes_makes_it_crash(stub_robot, drive):
    rng = np.random.default_rng(1)
    robot = stub_robot(
        aborts=lambda time, goal: rng.random() < 0.2, drive=drive, return_to_start=True
    )
    exploration = robot.exploration
    calls = [
        exploration.pause,
        exploration.resume,
        exploration.resume,
        exploration.return_to_start,
        lambda: exploration.goal_ended(int(rng.integers(100)), reached=False),
    ]
    for _ in range(250):
        given = {}
        if rng.random() < 0.1:
            poses = [None, Pose2D(math.nan, 1.0, 1.0), Pose2D(*rng.uniform(-3.0, 12.0, 3))]
            given["pose"] = poses[rng.integers(3)]
        if rng.random() < 0.1:
            beams = rng.uniform(0.0, 5.0, rng.integers(400)).astype(np.float32)
            step, reach = (
                rng.choice([0.01, -0.01, 0.0, math.nan]),
                rng.choice([3.5, 12.0, math.inf, 0.0]),
            )
            given["scan"] = LaserScan(0.0, beams, LaserGeometry(180, -3.0, step, 0.1, reach))
        if rng.random() < 0.03:
            given["stamp"] = rng.choice([math.nan, 0.0, 2e9])
        if rng.random() < 0.1:
            calls[rng.integers(len(calls))]()
        if rng.random() < 0.03:
            values = rng.choice(np.array([-1, 0, 50, 100], np.int8), rng.integers(1, 90, 2))
            origin = Pose2D(*rng.uniform(-1.0, 1.0, 2), 0.0)
            exploration.take_map(
                robot.maps.take(values, *values.shape[::-1], rng.choice([0.02, 0.1]), origin)
            )
        order = robot.step(**given)
        assert all(map(math.isfinite, order.twist))
        exploration.view()
