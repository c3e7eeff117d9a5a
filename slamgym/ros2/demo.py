"""The three nodes at once, each in a process of its own, until the building is explored."""

import math
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from std_msgs.msg import Float32

from slamgym.core.errors import SlamgymError
from slamgym.core.progress import duration, say, tell
from slamgym.interop.ros_messages import pose_of, stamp_of
from slamgym.ros2.frames import PoseHistory
from slamgym.ros2.node import RosNode, run_node
from slamgym.ros2.parameters import DemoParameters

GRACE = 10.0
"""A node that was asked to end gets so long [s]."""


class DemoNode(RosNode):
    """Watches the other nodes and compares them with the truth.

    Args:
        parameters: What the command line says.
        nodes: The processes, by the names of their commands.

    Attributes:
        coverage: Share of the reachable floor that was seen.
        errors: Between the poses that were believed and the true ones, in order [m].
        stamp: Robot time [s].
        ended: Name of the process that has ended.
    """

    def __init__(
        self, parameters: DemoParameters, nodes: dict[str, subprocess.Popen[bytes]]
    ) -> None:
        super().__init__("slamgym_demo", parameters)
        self._nodes = nodes
        self._truth = PoseHistory()
        self.coverage = 0.0
        self.errors: list[float] = []
        self.stamp = 0.0
        self.ended = ""
        self.listen(Float32, "ground_truth/coverage", self._take_coverage)
        self.listen(PoseStamped, "ground_truth/pose", self._take_truth)
        self.listen(PoseWithCovarianceStamped, "pose", self._take_pose)
        self.create_timer(0.2, self._look, clock=self.wall_clock)

    def _take_coverage(self, message: Any) -> None:
        self.coverage = message.data

    def _take_truth(self, message: Any) -> None:
        self._truth.add(stamp_of(message.header, 0.0), pose_of(message.pose, "pose"))

    def _take_pose(self, message: Any) -> None:
        self.stamp = stamp_of(message.header, 0.0)
        truth = self._truth.at(self.stamp)
        pose = pose_of(message.pose.pose, "pose")
        if truth is not None:
            self.errors.append(math.dist(pose[:2], truth[:2]))

    def _look(self) -> None:
        """End as soon as one of the nodes has ended."""
        for name, node in self._nodes.items():
            if node.poll() is not None:
                self.ended = name
                self.worker.end()
                return


def run_demo(parameters: DemoParameters, ros_arguments: Sequence[str]) -> int:
    """Explore a building over topics.

    Returns:
        The explorer's exit code.

    Raises:
        SlamgymError: If another node has ended before it.
    """
    begun = time.monotonic()
    nodes = _start_nodes(parameters, ros_arguments)
    watched: list[DemoNode] = []

    def make() -> DemoNode:
        watched.append(DemoNode(parameters, nodes))
        return watched[0]

    try:
        run_node(make, ros_arguments)
    finally:
        for node in reversed(nodes.values()):
            end_process(node)
    seen = watched[0]
    errors = seen.errors or [math.nan]
    if seen.ended not in ("", "explore"):
        raise SlamgymError(f"the node {seen.ended} ended early; its last lines say why")
    say(
        f"{100.0 * seen.coverage:.1f} % of the floor seen in {duration(seen.stamp)} of robot time "
        f"({duration(time.monotonic() - begun)} here); the robot was {np.mean(errors):.3f} m from where it believed to "
        f"be on average, {errors[-1]:.2f} m at the end"
    )
    tell(str(parameters.out))
    return int(nodes["explore"].returncode)


def _start_nodes(
    parameters: DemoParameters, ros_arguments: Sequence[str]
) -> dict[str, subprocess.Popen[bytes]]:
    """Start the processes, by the names of their commands."""
    commands = {
        "sim": [
            *_option("plans", parameters.plans),
            *_option("plan", parameters.plan),
            *_option("start", *parameters.start),
            *_option("seed", parameters.seed),
            *_option("speed", parameters.speed),
        ],
        "map": ["--out", str(parameters.out)],
        "explore": [
            *_option("explorer", parameters.explorer),
            *_option("out", parameters.out),
            *_option("rerun", parameters.rerun),
            *_option("video", parameters.video),
            *_option("view", parameters.view),
            "--exit",
        ],
    }
    nodes = {}
    for name, words in commands.items():
        nodes[name] = subprocess.Popen(
            [sys.executable, "-P", "-m", "slamgym", "ros2", name, *words, *ros_arguments],
            start_new_session=True,  # Ctrl-C reaches this process alone, which ends them in order
        )
    return nodes


def _option(name: str, *values: object) -> list[str]:
    """An option as it is typed; nothing if it is empty."""
    if values in ((), ("",)):
        return []
    return [f"--{name}", *map(str, values)]


def end_process(node: subprocess.Popen[bytes]) -> None:
    """Ask a node to end, and then make it."""
    if node.poll() is None:
        node.send_signal(signal.SIGINT)
        try:
            node.wait(GRACE)
        except subprocess.TimeoutExpired:
            node.kill()
            node.wait()
