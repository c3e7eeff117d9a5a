"""Nodes in processes of their own, started in any order, killed, and ended by signals."""

import contextlib
import os
import re
import signal
import subprocess
import sys
import time

import pytest

pytest.importorskip("rclpy")

from slamgym.core.errors import InputFileError
from slamgym.interop import read_ros_map
from slamgym.interop.logs import open_log
from slamgym.ros2.run_files import LOG

PLAN = "home_000009"
PATIENT = 120.0
"""A busy machine is waited for so long [s]."""


SAVING_OFTEN = """
from slamgym.commands.cli import main
from slamgym.ros2 import mapping
mapping.SAVE_INTERVAL = 0.5
raise SystemExit(main())
"""
"""A mapper that saves not each minute but all the time."""


def scans_in(log):
    """How many scans a log holds, as far as it has been written; 0 if there is none."""
    try:
        return len(open_log(log).records)
    except InputFileError:
        return 0


def received(shown):
    """What a node has said that it received, in one line or, if it came in different seconds, in several."""
    return {topic for topics in re.findall(r"received (.+)", shown) for topic in topics.split(", ")}


class Nodes:
    """Processes that write to files."""

    def __init__(self, folder):
        self.folder, self.running, self.texts = folder, [], {}

    def start(self, name, *words, as_name=None, code=None):
        text = self.folder / f"{as_name or name}.txt"
        program = ["-m", "slamgym"] if code is None else ["-c", code]
        with text.open("wb") as file:
            command = [sys.executable, *program, "ros2", name, *words]
            process = subprocess.Popen(command, cwd=self.folder, stdout=file, stderr=file)
        self.running.append(process)
        self.texts[process] = text
        return process

    def shown(self, process):
        return self.texts[process].read_text()

    def wait_for(self, process, part, count=1):
        """Wait until a node has said something so often."""
        end = time.monotonic() + PATIENT
        while self.shown(process).count(part) < count:
            assert time.monotonic() < end, f"{part!r} is missing in: {self.shown(process)}"
            assert process.poll() is None, self.shown(process)
            time.sleep(0.05)

    def wait_until(self, is_so):
        """Wait until something is so."""
        end = time.monotonic() + PATIENT
        while not is_so():
            assert time.monotonic() < end, {
                text.name: text.read_text() for text in self.texts.values()
            }
            time.sleep(0.2)

    def end(self, process, number=signal.SIGINT):
        """Ask a node to end; returns its exit code and what it said."""
        process.send_signal(number)
        code = process.wait(PATIENT)
        assert "Traceback" not in self.shown(process)
        return code, self.shown(process)


@pytest.fixture
def nodes(ros_domain, tmp_path):
    nodes = Nodes(tmp_path)
    yield nodes
    for process in nodes.running:
        with contextlib.suppress(ProcessLookupError):
            os.kill(process.pid, signal.SIGKILL)
        process.wait()


def test_killed_and_restarted_in_any_order_the_exploration_goes_on(nodes, tmp_path):
    """The explorer comes first, then the simulator; the mapper last, which is killed on the way and continued."""
    explorer = nodes.start("explore", "--explorer", "tour", "--out", "explored")
    nodes.wait_for(explorer, "waiting for map, odom, scan")
    robot = nodes.start("sim", "--plan", PLAN, "--speed", "5")
    nodes.wait_until(lambda: received(nodes.shown(explorer)) >= {"odom", "scan"})
    mapper = nodes.start("map", "--out", "mapped", as_name="first", code=SAVING_OFTEN)
    nodes.wait_for(explorer, "exploring:", count=3)
    nodes.wait_until(lambda: scans_in(tmp_path / "mapped" / LOG) > 10)
    mapper.send_signal(signal.SIGKILL)
    mapper.wait()
    mapped = scans_in(tmp_path / "mapped" / LOG)
    nodes.wait_for(explorer, "waiting for the robot's pose on the map")
    explored = nodes.shown(explorer).count("exploring:")
    again = nodes.start("map", "--out", "mapped", "--continue", as_name="second")
    nodes.wait_for(again, f"the map goes on from the {mapped} scans of mapped/run1/{LOG}")
    nodes.wait_for(explorer, "exploring:", count=explored + 3)
    for process, number in (
        (explorer, signal.SIGTERM),
        (again, signal.SIGTERM),
        (robot, signal.SIGINT),
    ):
        assert nodes.end(process, number)[0] == 0
    assert read_ros_map(tmp_path / "mapped/map.yaml").cells.size
    assert read_ros_map(tmp_path / "mapped/run1/map.yaml").cells.size
    assert scans_in(tmp_path / "mapped/run1" / LOG) == mapped
    assert scans_in(tmp_path / "mapped" / LOG) > mapped + 10


def test_a_folder_in_use_and_ros_arguments_that_are_wrong_end_a_node_in_a_sentence(nodes):
    mapper = nodes.start("map", "--out", "mapped", as_name="first")
    nodes.wait_for(mapper, "waiting for odom, scan")
    second = nodes.start("map", "--out", "mapped", as_name="second")
    assert second.wait(PATIENT) == 2
    assert nodes.shown(second).count("\n") == 1
    assert "another run is writing to this folder" in nodes.shown(second)
    code, shown = nodes.end(mapper)
    assert code == 0
    assert "saved" not in shown  # there was nothing to save
