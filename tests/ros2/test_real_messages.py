"""Nodes with the real tf2_msgs, nav2_msgs and map_msgs: built by ``make messages``, or those of a ROS installation."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from source_tree import ROOT

HERE = Path(__file__).parent
BUILT = Path(os.environ.get("SLAMGYM_ROS_MESSAGES", ROOT / "build" / "ros_messages")) / "setup.env"

LONGEST = 240.0
"""Nodes take so long at most until they have started and something is to be seen [s]: on a quiet machine 10."""


@pytest.fixture
def environment(ros_domain):
    """Variables with which programs find the messages."""
    if not BUILT.exists():
        pytest.skip("`make messages` builds tf2_msgs, nav2_msgs and map_msgs")
    variables = dict(line.split("=", 1) for line in BUILT.read_text().splitlines())
    paths = {
        name: os.pathsep.join(filter(None, [value, os.environ.get(name, "")]))
        for name, value in variables.items()
    }
    return os.environ | paths


def start(environment, *words):
    return subprocess.Popen(
        [sys.executable, "-W", "ignore", *words],
        env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip


def end(*programs):
    for program in programs:
        program.terminate()
    for program in programs:
        try:
            program.communicate(timeout=20)
        except subprocess.TimeoutExpired:
            program.kill()
            program.communicate()


def start_robot(environment, folder, *options):
    """A simulated robot, its mapper and its explorer, which takes the options."""
    node = ["-m", "slamgym", "ros2"]
    clock = ["--ros-args", "-p", "use_sim_time:=true"]
    explored = ["--out", str(folder / "explored"), *options]
    return [
        start(environment, *node, "sim", "--plan", "home_000001", "--speed", "2"),
        start(environment, *node, "map", "--out", str(folder / "map"), *clock),
        start(environment, *node, "explore", *explored, *clock),
    ]


def test_transforms_lead_from_the_map_to_the_laser_at_the_rates_that_nav2_needs(
    environment, tmp_path
):
    programs = start_robot(environment, tmp_path)
    listener = start(environment, str(HERE / "tf_listener.py"), "100", str(LONGEST))
    try:
        printed, _ = listener.communicate(timeout=2 * LONGEST)
    finally:
        end(*programs, listener)
    found = json.loads(printed.strip().splitlines()[-1])
    assert found["static"] == ["base_footprint -> base_link", "base_link -> base_scan"]
    assert found["rates"]["odom -> base_footprint"] == pytest.approx(30.0, rel=0.2)
    assert found["rates"]["map -> odom"] > 4.0
    assert found["backwards"] == 0
    assert found["poses"] > 30
    assert found["error"] < 0.15  # the mapper's own errors are some centimetres


def test_goals_go_to_nav2s_action_and_an_aborted_one_is_followed_by_another(environment, tmp_path):
    programs = start_robot(environment, tmp_path, "--drive", "goals")
    server = start(environment, str(HERE / "goal_server.py"), "2", str(LONGEST))
    try:
        printed, _ = server.communicate(timeout=2 * LONGEST)
    finally:
        end(*programs, server)
    found = json.loads(printed.strip().splitlines()[-1])
    assert len(found["goals"]) == 2
    assert {goal["frame"] for goal in found["goals"]} == {"map"}
    assert found["updates"] == ["map_msgs/msg/OccupancyGridUpdate"]
