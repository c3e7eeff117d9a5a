"""The live view: what the page is sent, and whose orders are taken."""

import http.client
import io
import json
import socket

import numpy as np
import pytest
from PIL import Image

from slamgym.core.errors import ConfigError
from slamgym.core.types import FREE, UNKNOWN, GridFrame, OccupancyGrid, Pose2D
from slamgym.ros2.live_view import ORDERS, LiveState, LiveView

CELLS = np.full((40, 60), UNKNOWN, np.uint8)
CELLS[10:30, 10:50] = FREE
GRID = OccupancyGrid(CELLS, GridFrame(0.05, -1.0, 2.0, 40, 60))


@pytest.fixture
def view():
    view = LiveView(0)
    yield view
    view.close()


def ask(view, method, path, **headers):
    connection = http.client.HTTPConnection("127.0.0.1", view.port, timeout=10.0)
    try:
        connection.request(method, path, headers=headers)
        answer = connection.getresponse()
        return answer.status, answer.read()
    finally:
        connection.close()


def test_the_page_asks_nobody_else(view):
    status, page = ask(view, "GET", "/")
    assert status == 200
    assert b"https://" not in page
    assert b"http://" not in page


def test_the_state_and_the_map_are_those_that_were_shown(view):
    frontier = np.array([[0.5, 2.5], [0.55, 2.5]])
    view.show(
        LiveState("exploring: 1 frontier", GRID, Pose2D(0.1, 2.9, 1.5), ((0.0, 2.9),), (), frontier)
    )
    state = json.loads(ask(view, "GET", "/state")[1])
    assert state["text"] == "exploring: 1 frontier"
    assert state["pose"] == [0.1, 2.9, 1.5]
    assert state["chosen"] == frontier.tolist()
    assert state["map"] == pytest.approx({"left": -1.0, "bottom": 2.0, "right": 2.0, "top": 4.0})
    picture = np.asarray(Image.open(io.BytesIO(ask(view, "GET", "/map.png?1")[1])))
    assert (picture == CELLS).all()


def test_before_the_first_map_there_is_a_text_alone(view):
    assert json.loads(ask(view, "GET", "/state")[1])["map"] is None
    assert ask(view, "GET", "/map.png")[0] == 404


@pytest.mark.parametrize("order", ORDERS)
def test_an_order_of_the_page_reaches_the_node(view, order):
    assert ask(view, "POST", "/", **{"X-Slamgym-Order": order})[0] == 200
    assert view.orders.get(timeout=5.0) == order


@pytest.mark.parametrize(
    ("method", "headers", "status"),
    [
        ("POST", {}, 400),
        ("POST", {"X-Slamgym-Order": "explode"}, 400),
        ("POST", {"X-Slamgym-Order": "stop", "Host": "evil.example"}, 403),
        ("GET", {"Host": "evil.example:80"}, 403),
    ],
)
def test_pages_of_others_order_and_read_nothing(view, method, headers, status):
    assert ask(view, method, "/", **headers)[0] == status
    assert view.orders.empty()


def test_a_port_that_is_taken_is_named(view):
    with pytest.raises(ConfigError, match=f"--view {view.port}: the port can't be used"):
        LiveView(view.port)


def test_after_the_end_the_port_is_free():
    view = LiveView(0)
    view.close()
    with socket.socket() as other:
        other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        other.bind(("127.0.0.1", view.port))


def test_the_stop_button_stops_a_driving_robot_and_the_page_shows_it(desk, monkeypatch):
    pytest.importorskip("rclpy")
    from ros2.test_explore_node import begin, is_zero

    from slamgym.ros2 import viewing

    monkeypatch.setattr(viewing, "LiveView", lambda _port: LiveView(0))
    robot = begin(desk, view=1).map().sense(5)
    live = robot.node._display._live
    assert not is_zero(robot.commands[-1])
    state = json.loads(ask(live, "GET", "/state")[1])
    assert state["text"] == robot.texts[-1]
    assert state["map"] is not None
    assert state["chosen"]
    assert ask(live, "POST", "/", **{"X-Slamgym-Order": "stop"})[0] == 200
    desk.tick(robot.node)
    assert is_zero(robot.commands[-1])
    robot.sense(3)
    assert robot.texts[-1] == "paused"
    ask(live, "POST", "/", **{"X-Slamgym-Order": "start"})
    desk.tick(robot.node)
    robot.sense(3)
    assert not is_zero(robot.commands[-1])
    robot.node.close()
