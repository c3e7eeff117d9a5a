"""``slamgym ros2``: the simulated robot, the mapper and the explorers as ROS 2 nodes."""

from __future__ import annotations

import os

from slamgym.commands.settings import AllSettings, SettingsOptions
from slamgym.ros2.parameters import (
    DemoParameters,
    ExploreParameters,
    MapParameters,
    MergeParameters,
    SimParameters,
)

RosArguments = tuple[str, ...]
"""The words from ``--ros-args`` on: remappings, and parameters, which overrule the options."""


class Ros2SimArguments(SimParameters):
    """A TurtleBot3 without Gazebo: /scan, /odom, /tf, /clock and the truth; drives by /cmd_vel."""

    settings: AllSettings = SettingsOptions()
    """Robot, sensors, furniture and people."""


class Ros2MapArguments(MapParameters):
    """Map as slam_toolbox and GMapping do: /scan and odometry in, /map, map -> odom and /pose out."""

    settings: AllSettings = SettingsOptions()
    """The mapper."""


def sim_command(arguments: Ros2SimArguments, ros: RosArguments) -> None:
    """Run the command."""
    from slamgym.envs import ExploreConfig
    from slamgym.ros2.node import run_node
    from slamgym.ros2.simulator import SimNode

    config = arguments.settings.configured(ExploreConfig(), {})
    if config.clutter.is_empty:
        _prepare("drive")
    else:
        _prepare("drive", "furnish")
    run_node(lambda: SimNode(arguments, config), ros)


def map_command(arguments: Ros2MapArguments, ros: RosArguments) -> None:
    """Run the command."""
    from slamgym.ros2.mapping import MapNode
    from slamgym.ros2.node import run_node
    from slamgym.slam import SlamConfig

    _prepare("pose_graph")

    def configure(suited: SlamConfig) -> SlamConfig:
        return arguments.settings.configured(suited, {})

    configure(SlamConfig())  # a wrong setting is refused before the first scan
    run_node(lambda: MapNode(arguments, configure), ros)


def merge_command(arguments: MergeParameters, ros: RosArguments) -> None:
    """Run the command."""
    from slamgym.ros2.merging import MergeNode
    from slamgym.ros2.node import run_node

    _prepare("pose_graph")
    run_node(lambda: MergeNode(arguments), ros)


def explore_command(arguments: ExploreParameters, ros: RosArguments) -> int:
    """Run the command."""
    if arguments.robots:
        from slamgym.ros2.team import run_team

        return run_team(arguments, arguments.robots, ros)
    from slamgym.ros2.exploring import ExploreNode
    from slamgym.ros2.node import run_node

    _prepare("navigate", "decide")
    run_node(lambda: ExploreNode(arguments), ros)
    return 0


def demo_command(arguments: DemoParameters, ros: RosArguments) -> int:
    """Run the command."""
    from slamgym.ros2.demo import run_demo

    os.environ.setdefault(
        "ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST"
    )  # its robot is nobody else's
    _prepare("drive", "pose_graph", "navigate", "decide")
    return run_demo(arguments, ros)


def _prepare(*parts: str) -> None:
    """Compile kernels before the first message."""
    from slamgym.core.parallel.backlog import available_cores
    from slamgym.envs.warmup import KERNEL_PARTS, compile_kernels

    compile_kernels(parts, available_cores())
    for part in parts:
        KERNEL_PARTS[part][0]()
