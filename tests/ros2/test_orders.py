"""Orders are heard at once and none is lost, however long the worker takes for a step."""

import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rclpy")

from ros_stand_ins import Message, odometry, pose_on_map, scan
from test_explore_node import begin, is_zero, look, map_message, room, with_navigation

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, GridFrame, OccupancyGrid
from slamgym.ros2.worker import MOST_PENDING, Worker


class Blocked:
    """Holds up each step of an exploration until it is let go; what comes meanwhile isn't waited for."""

    def __init__(self, desk, robot, monkeypatch):
        self.desk, self.robot, self.go, self.began = (
            desk,
            robot,
            threading.Event(),
            threading.Event(),
        )
        step = robot.node._exploration.step

        def slow(*args):
            order = step(*args)
            self.began.set()
            assert self.go.wait(30.0)
            return order

        monkeypatch.setattr(robot.node._exploration, "step", slow)
        self.scan()
        assert self.began.wait(30.0)

    def hear(self, topic, message):
        for end in list(self.desk.answers[self.robot.node]):
            if end.topic == topic:
                end.callback(message)

    def scan(self):
        """A scan that the robot drives by."""
        robot = self.robot
        robot.stamp += 0.2
        self.hear("/odom", odometry(robot.stamp, robot.pose))
        self.hear("/scan", scan(robot.stamp, look(robot.pose, robot.gap)))
        self.hear("/pose", pose_on_map(robot.stamp, robot.pose))

    def release(self):
        self.go.set()
        self.desk.settle(self.robot.node)


@pytest.mark.parametrize("how", ["topic", "service", "end"])
def test_a_stop_acts_while_a_step_is_computed_and_that_step_drives_nobody(desk, monkeypatch, how):
    robot = begin(desk).map().sense(5)
    assert not is_zero(robot.commands[-1])
    blocked = Blocked(desk, robot, monkeypatch)
    for _ in range(30):
        blocked.scan()
    count = len(robot.commands)
    if how == "topic":
        blocked.hear("/explore/resume", Message(data=False))
    elif how == "service":
        assert desk.call(robot.node, "stop").success
    else:
        robot.node.halt()  # what Ctrl-C does first
    assert [is_zero(one) for one in robot.commands[count:]] == [True]
    for _ in range(30):
        blocked.scan()
    blocked.release()
    assert all(is_zero(one) for one in robot.commands[count:])
    if how == "end":
        return
    assert robot.texts[-1] == "paused"
    assert desk.call(robot.node, "start").success
    robot.sense(3)
    assert not is_zero(robot.commands[-1])


def office(side=60.0, room=4.0):
    """A building of 225 rooms with doors, of which the right half isn't known yet."""
    count = round(side / 0.05)
    pitch = round(room / 0.05)
    cells = np.full((count, count), FREE, np.uint8)
    walls = np.arange(0, count, pitch)
    cells[walls] = cells[:, walls] = OCCUPIED
    middles = walls + pitch // 2
    for wall in walls[1:]:
        for middle in middles:
            cells[wall, middle - 9 : middle + 9] = FREE
            cells[middle - 9 : middle + 9, wall] = FREE
    cells[:, count // 2 + 10 :] = UNKNOWN
    first = -0.05 * (middles[3] + 0.5)
    return OccupancyGrid(cells, GridFrame(0.05, first, first, count, count))


def test_a_step_of_a_tour_through_225_rooms_delays_no_stop(desk, monkeypatch):
    robot = begin(desk, explorer="tour").map().sense(3)
    blocked = Blocked(desk, robot, monkeypatch)
    blocked.release()
    began, ended = threading.Event(), threading.Event()
    step = robot.node._exploration.step

    def long_step(*args):
        began.set()
        order = step(*args)
        ended.set()
        return order

    monkeypatch.setattr(robot.node._exploration, "step", long_step)
    blocked.hear("/map", map_message(office(), stamp=robot.stamp))
    blocked.scan()
    assert began.wait(60.0)
    count = len(robot.commands)
    begun = time.thread_time()
    blocked.hear("/explore/resume", Message(data=False))
    seconds = time.thread_time() - begun
    assert not ended.is_set()  # a step takes 0.5 CPU s, most of it without the interpreter's lock
    assert [is_zero(one) for one in robot.commands[count:]] == [True]
    assert seconds < 0.02  # of its own: a control period is 0.2 s
    desk.settle(robot.node)
    assert ended.is_set()
    assert all(is_zero(one) for one in robot.commands[count:])


def test_a_stop_and_a_start_during_one_step_leave_the_robot_driving(desk, monkeypatch):
    robot = begin(desk).map().sense(5)
    blocked = Blocked(desk, robot, monkeypatch)
    blocked.hear("/explore/resume", Message(data=False))
    blocked.hear("/explore/resume", Message(data=True))
    blocked.release()
    robot.sense(3)
    assert not is_zero(robot.commands[-1])


def test_a_robot_whose_step_takes_longer_than_a_second_is_stopped(desk, monkeypatch):
    robot = begin(desk).map().sense(5)
    blocked = Blocked(desk, robot, monkeypatch)
    assert not is_zero(robot.commands[-1])
    desk.later += 1.1
    for timer in list(robot.node.timers):
        timer.callback()
    assert is_zero(robot.commands[-1])
    blocked.release()


def test_the_only_map_is_not_dropped(desk, monkeypatch):
    robot = begin(desk).sense(3)
    blocked = Blocked(desk, robot, monkeypatch)
    blocked.hear("/map", map_message(room(gap=True)))
    for _ in range(3 * MOST_PENDING):
        blocked.scan()
    blocked.release()
    robot.gap = True
    robot.sense(3)
    assert not is_zero(robot.commands[-1])


def test_goals_and_their_results_are_not_dropped(desk, monkeypatch):
    robot, navigation = with_navigation(desk, monkeypatch, "hang")
    results = []
    monkeypatch.setattr(
        robot.node._exploration, "goal_ended", lambda number, reached: results.append(reached)
    )
    robot.map().sense(3)
    assert len(navigation.goals) == 1
    blocked = Blocked(desk, robot, monkeypatch)
    robot.node._driver._goals._take_result(
        1,
        robot.node._driver._goals._handle,
        SimpleNamespace(result=lambda: SimpleNamespace(status=4)),
    )
    for _ in range(3 * MOST_PENDING):
        blocked.scan()
    blocked.release()
    assert results == [True]


def test_a_stop_cancels_the_goal_at_once_and_a_start_sends_it_again(desk, monkeypatch):
    robot, navigation = with_navigation(desk, monkeypatch, "hang")
    robot.map().sense(3)
    blocked = Blocked(desk, robot, monkeypatch)
    blocked.hear("/explore/resume", Message(data=False))
    assert navigation.cancelled == 1
    blocked.hear("/explore/resume", Message(data=True))
    blocked.release()
    robot.sense(3)
    assert len(navigation.goals) == 2


# --- the worker ---


def busy_worker():
    """A worker that is busy until the event is set."""
    go, worker = threading.Event(), Worker(lambda: None)
    worker.order(go.wait)
    while worker.num_pending:
        time.sleep(0.001)
    return worker, go


def test_orders_overtake_data_and_only_data_are_thinned():
    worker, go = busy_worker()
    done = []
    for number in range(50):
        worker.put(lambda number=number: done.append(number))
        worker.order(lambda number=number: done.append(f"order {number}"))
    end = threading.Event()
    worker.put(end.set)
    go.set()
    assert end.wait(30.0)
    assert done[:50] == [f"order {number}" for number in range(50)]
    assert done[50:] == list(range(50))[1 - MOST_PENDING :]
    assert worker.dropped == 51 - MOST_PENDING


def test_a_newer_order_replaces_those_of_its_kind_alone():
    worker, go = busy_worker()
    done = []
    worker.order(lambda: done.append("map 1"), "map", replaces=True)
    worker.order(lambda: done.append("update of 1"), "map")
    worker.order(lambda: done.append("pause"))
    worker.order(lambda: done.append("map 2"), "map", replaces=True)
    worker.order(lambda: done.append("update of 2"), "map")
    end = threading.Event()
    worker.put(end.set)
    go.set()
    assert end.wait(30.0)
    assert done == ["pause", "map 2", "update of 2"]


def test_an_update_of_the_map_that_waits_is_put_into_the_map_that_waits(desk, monkeypatch):
    robot = begin(desk).map(gap=False).sense(3)
    blocked = Blocked(desk, robot, monkeypatch)
    blocked.hear("/map", map_message(room(gap=False)))
    part = np.zeros(30 * 6, np.int8)
    robot.node._take_update(Message(x=98, y=45, width=6, height=30, data=part))
    known = robot.node._exploration.view().known_area
    blocked.release()
    robot.sense(30)
    assert robot.node._exploration.view().known_area > known


def test_a_pause_of_the_mapper_waits_for_nothing(desk):
    from test_map_node import begin as begin_mapper

    node = begin_mapper(desk)
    with node.worker.lock:  # a long step
        assert desk.call(node, "pause", data=True).success
