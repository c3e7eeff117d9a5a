"""Hours of robot time over ROS topics: memory, stuck robots, and what each exploration saw.

    python benchmarks/exploring/ros2_soak.py [--hours 10] [--plans procedural]

The simulator, the mapper and the explorer run as processes, as fast as the explorer drives. When an exploration is done
the simulator is reset with the next seed, and so another building: its clock jumps back, the others begin again by
themselves. An exploration that isn't done within its limit counts as stuck.
"""

import math
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")

import numpy as np
import rclpy
import tyro
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from std_msgs.msg import Float32, String
from std_srvs.srv import Trigger

from slamgym.core.progress import say
from slamgym.interop.ros_messages import pose_of, stamp_of
from slamgym.ros2.frames import PoseHistory
from slamgym.ros2.node import LATCHED

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save, resident_mb

MODULES = ("slamgym/planning", "slamgym/ros2", "slamgym/sim", "slamgym/slam")
"""What is measured."""

NODES = "sim", "map", "explore"


@dataclass(frozen=True)
class Arguments:
    """Hours of robot time over ROS topics."""

    hours: float = 10.0
    """Robot time in all [h]."""
    limit: float = 2400.0
    """An exploration that takes longer is stuck [s of robot time]."""
    plans: str = "procedural"
    """Floor plans."""
    explorer: str = "tour"
    """Who chooses."""
    seed: int = 1000
    """Of the first exploration; each of the following has the next."""


class Watch(Node):
    """Listens to the nodes, and resets the simulator."""

    def __init__(self) -> None:
        super().__init__("slamgym_soak")
        self.stamp = 0.0
        self.coverage = 0.0
        self.status = ""
        self.error = math.nan
        self._truth = PoseHistory()
        self.create_subscription(Float32, "ground_truth/coverage", self._take_coverage, 10)
        self.create_subscription(PoseStamped, "ground_truth/pose", self._take_truth, 10)
        self.create_subscription(PoseWithCovarianceStamped, "pose", self._take_pose, 10)
        self.create_subscription(String, "explore/status", self._take_status, LATCHED)
        self._set = self.create_client(SetParameters, "slamgym_sim/set_parameters")
        self._reset = self.create_client(Trigger, "slamgym_sim/reset")

    def _take_coverage(self, message: Any) -> None:
        self.coverage = message.data

    def _take_status(self, message: Any) -> None:
        self.status = message.data

    def _take_truth(self, message: Any) -> None:
        self.stamp = stamp_of(message.header, 0.0)
        self._truth.add(self.stamp, pose_of(message.pose, "pose"))

    def _take_pose(self, message: Any) -> None:
        truth = self._truth.at(stamp_of(message.header, 0.0))
        pose = pose_of(message.pose.pose, "pose")
        if truth is not None:
            self.error = math.dist(truth[:2], pose[:2])

    def reset(self, seed: int) -> None:
        """Begin another exploration."""
        value = ParameterValue(type=ParameterType.PARAMETER_INTEGER, integer_value=seed)
        self._call(
            self._set, SetParameters.Request(parameters=[Parameter(name="seed", value=value)])
        )
        self.status = ""
        self._call(self._reset, Trigger.Request())

    def _call(self, client: Any, request: Any) -> None:
        client.wait_for_service(30.0)
        rclpy.spin_until_future_complete(self, client.call_async(request), timeout_sec=60.0)


def main() -> None:
    """Run, print and save."""
    arguments = tyro.cli(Arguments)
    rclpy.init()
    watch = Watch()
    with tempfile.TemporaryDirectory() as folder:
        options = {
            "sim": ["--plans", arguments.plans, "--seed", str(arguments.seed), "--speed", "0"],
            "map": ["--out", f"{folder}/map"],
            "explore": ["--out", f"{folder}/explore", "--explorer", arguments.explorer],
        }
        command = [sys.executable, "-m", "slamgym", "ros2"]
        with (Path(folder) / "log").open("w") as log:
            nodes = [
                subprocess.Popen([*command, name, *options[name]], stderr=log) for name in NODES
            ]
            try:
                rows, memory = soak(watch, nodes, arguments)
            except SystemExit:
                say(Path(log.name).read_text()[-2000:])
                raise
            finally:
                for node in nodes:
                    node.terminate()
                for node in nodes:
                    node.wait(30.0)
    hours = sum(row[1] for row in rows) / 60.0
    done = sum(row[3] == "done" for row in rows)
    coverage = np.array([row[2] for row in rows])
    error = np.array([row[4] for row in rows])
    columns = ["seed", "robot minutes", "coverage [%]", "ended", "error [m]", "wall s"]
    print_and_save(
        "exploring/ros2_soak",
        f"{hours:.1f} h of robot time, {done} of {len(rows)} explorations done, coverage {coverage.mean():.1f} % "
        f"(least {coverage.min():.1f}), error {error.mean():.3f} m (most {error.max():.3f})",
        [[*row, *sizes] for row, sizes in zip(rows, memory, strict=True)],
        columns + [f"{name} [MB]" for name in NODES],
        MODULES,
    )


def soak(
    watch: Watch, nodes: list[Any], arguments: Arguments
) -> tuple[list[list[Any]], list[list[float]]]:
    """Explore until the hours are over: a row for each exploration, and the memory of the nodes after it [MB]."""
    rows: list[list[Any]] = []
    memory: list[list[float]] = []
    seed = arguments.seed
    driven = 0.0
    while driven < 3600.0 * arguments.hours:
        begun = time.monotonic()
        while not watch.status.startswith("done") and watch.stamp < arguments.limit:
            rclpy.spin_once(watch, timeout_sec=0.5)
            ended = [
                name for name, node in zip(NODES, nodes, strict=True) if node.poll() is not None
            ]
            if ended:
                raise SystemExit(f"the node {ended[0]} has ended")
        ending = "done" if watch.status.startswith("done") else f"stuck: {watch.status}"
        wall = time.monotonic() - begun
        driven += watch.stamp
        rows.append(
            [
                seed,
                round(watch.stamp / 60.0, 1),
                round(100.0 * watch.coverage, 1),
                ending,
                round(watch.error, 3),
                round(wall),
            ]
        )
        memory.append([round(resident_mb(node.pid), 1) for node in nodes])
        say(" ".join(map(str, [*rows[-1], *memory[-1]])))
        seed += 1
        watch.reset(seed)
        watch.stamp = 0.0
    return rows, memory


if __name__ == "__main__":
    main()
