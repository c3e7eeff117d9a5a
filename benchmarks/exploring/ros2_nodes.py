"""How long do the callbacks of the ROS 2 nodes take, and does their memory grow, in explorations on end?

    python benchmarks/exploring/ros2_nodes.py [--speed 10] [--hours 1]

The simulator, the mapper and the explorer run in processes of their own over loopback, as with `slamgym ros2 demo`.
When the robot says that it is done, the simulator begins again with the next seed, without an end of the other nodes:
their clock jumps back, the map is put aside, and the next exploration begins. Drawings are left out. Each callback of a
subscription or a timer is timed while the worker thread of its node has work as usual.

The resident set is read from /proc after each tenth of a robot hour; growth is the slope of the second half.
"""

import contextlib
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save, resident_mb

MODULES = ("slamgym/planning", "slamgym/ros2", "slamgym/sim", "slamgym/slam")
"""What is measured."""

NODES = {"sim": (), "map": ("--out", "mapped"), "explore": ("--out", "explored")}
GOAL_MS = 50.0
"""What callbacks should take at the 99th percentile."""


@dataclass(frozen=True)
class Arguments:
    """Callbacks and memory of the nodes."""

    speed: float = 0.0
    """Times real time; 0: as fast as commands come."""
    hours: float = 1.0
    """Robot time."""
    plans: str = "bundled"
    """Floor plans."""
    node: str = ""
    """Run this node and write its times to the file of `times`; the benchmark starts itself so."""
    times: Path = Path("times.json")
    """Where a node writes its times."""


def main() -> None:
    arguments = tyro.cli(Arguments)
    if arguments.node:
        run_timed(arguments)
        return
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as running:
        nodes = {name: start(name, arguments, Path(folder), running) for name in NODES}
        samples, explored, wall = watch(arguments, nodes)
        running.close()
        times = {name: json.loads((Path(folder) / f"{name}.json").read_text()) for name in NODES}
    table = np.array(samples)
    half = table[len(table) // 2 :]
    rows = []
    for column, (name, found) in enumerate(times.items(), start=1):
        shares = np.percentile(found, [50.0, 99.0, 100.0])
        growth = np.polyfit(half[:, 0], half[:, column], 1)[0]
        rows.append(
            [
                name,
                len(found),
                *np.round(1000.0 * shares, 2).tolist(),
                table[-1, column],
                round(growth, 1),
            ]
        )
    print_and_save(
        f"exploring/ros2_nodes_{arguments.speed:g}",
        f"{table[-1, 0]:.1f} h of robot time, {explored} explorations, {wall / 60.0:.0f} min here (goal: below "
        f"{GOAL_MS:g} ms at p99, no growth)",
        rows,
        ("node", "callbacks", "p50 [ms]", "p99 [ms]", "most [ms]", "memory [MB]", "growth [MB/h]"),
        MODULES,
    )


def start(
    name: str, arguments: Arguments, folder: Path, running: contextlib.ExitStack
) -> "subprocess.Popen[bytes]":
    """Start this script as a node, which is asked to end when the block ends."""
    words = ["--node", name, "--times", str(folder / f"{name}.json"), "--plans", arguments.plans]
    command = [
        sys.executable,
        str(Path(__file__).resolve()),
        *words,
        "--speed",
        f"{arguments.speed:g}",
    ]
    with (folder / f"{name}.txt").open("wb") as text:
        node = subprocess.Popen(command, cwd=folder, stdout=text, stderr=text)
    running.callback(node.wait, 60.0)
    running.callback(node.terminate)
    return node


def leave_out(folder: Any) -> int:
    """Draw nothing."""
    del folder
    return 0


def run_timed(arguments: Arguments) -> None:
    """Run one node with timed callbacks."""
    from rclpy.node import Node

    from slamgym.commands.cli import main as run_command
    from slamgym.ros2 import exploring

    times: list[float] = []

    def timed(callback: Callable[..., Any]) -> Callable[..., Any]:
        def call(*values: Any) -> Any:
            began = time.perf_counter()
            try:
                return callback(*values)
            finally:
                times.append(time.perf_counter() - began)

        return call

    subscribe = Node.create_subscription
    create_timer = Node.create_timer
    Node.create_subscription = lambda node, kind, topic, callback, *others, **named: subscribe(
        node, kind, topic, timed(lambda message: callback(message)), *others, **named
    )
    Node.create_timer = lambda node, period, callback, **named: create_timer(
        node, period, timed(lambda: callback()), **named
    )
    exploring.draw_saved_map = leave_out
    words = [*NODES[arguments.node]]
    if arguments.node == "sim":
        words = ["--plans", arguments.plans, "--speed", f"{arguments.speed:g}"]
    code = run_command(["ros2", arguments.node, *words])
    arguments.times.write_text(json.dumps(times))
    sys.exit(code)


def watch(
    arguments: Arguments, nodes: dict[str, "subprocess.Popen[bytes]"]
) -> tuple[list[list[float]], int, float]:
    """Robot time [h] and memory of each node [MB], explorations, and the time that it all took [s].

    Begins the next exploration whenever one is done.
    """
    import rclpy
    from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
    from rcl_interfaces.srv import SetParameters
    from rosgraph_msgs.msg import Clock
    from std_msgs.msg import String
    from std_srvs.srv import Trigger

    from slamgym.ros2.node import LATCHED

    rclpy.init(signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
    node = rclpy.create_node("ros2_nodes_benchmark")
    before = 0.0
    now = 0.0
    explored = 0
    is_done = threading.Event()

    def tick(message: Any) -> None:
        nonlocal before, now
        stamp = message.clock.sec + 1e-9 * message.clock.nanosec
        before += now if stamp < now - 1.0 else 0.0
        now = stamp

    def note(message: Any) -> None:
        if message.data.startswith("done"):
            is_done.set()

    node.create_subscription(Clock, "/clock", tick, 10)
    node.create_subscription(String, "explore/status", note, LATCHED)
    seeds = node.create_client(SetParameters, "slamgym_sim/set_parameters")
    resets = node.create_client(Trigger, "slamgym_sim/reset")
    samples: list[list[float]] = []
    began = time.monotonic()
    try:
        while before + now < 3600.0 * arguments.hours:
            rclpy.spin_once(node, timeout_sec=1.0)
            ended = [name for name, process in nodes.items() if process.poll() is not None]
            if ended:
                raise SystemExit(f"the node {ended[0]} ended early")
            if is_done.is_set():
                is_done.clear()
                explored += 1
                value = ParameterValue(type=ParameterType.PARAMETER_INTEGER, integer_value=explored)
                request = SetParameters.Request(parameters=[Parameter(name="seed", value=value)])
                rclpy.spin_until_future_complete(node, seeds.call_async(request))
                rclpy.spin_until_future_complete(node, resets.call_async(Trigger.Request()))
            hours = (before + now) / 3600.0
            if hours >= 0.1 * (len(samples) + 1) * min(1.0, arguments.hours):
                samples.append(
                    [hours, *(round(resident_mb(process.pid), 1) for process in nodes.values())]
                )
    finally:
        wall = time.monotonic() - began
        rclpy.shutdown()
    return samples, explored, wall


if __name__ == "__main__":
    main()
