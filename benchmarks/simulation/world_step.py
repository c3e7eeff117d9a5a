"""The world and the sensors: microseconds of each part of a control step of 0.2 s, and of a reset.

Run: ``python benchmarks/simulation/world_step.py``.
"""

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from raycast import cpu_microseconds

from slamgym.cad.floorplan import FloorPlan, Room
from slamgym.core.types import Pose2D, Twist2D
from slamgym.sim import (
    ClutterConfig,
    Lidar,
    LidarConfig,
    OdometryConfig,
    RobotConfig,
    WheelOdometry,
    World,
    make_clutter,
    sample_start,
)

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

MODULES = ("slamgym/sim",)
"""What is measured."""

DT = 0.2  # [s]
ROOM = 4.0  # [m]


@dataclass(frozen=True)
class Case:
    """One world to step in."""

    name: str
    world: World
    start: Pose2D
    command: Twist2D


def building(rooms_x: int, rooms_y: int) -> FloorPlan:
    """Rooms of 4 m side with doors of 1 m to all their neighbours and walls of 0.1 m."""
    rooms = [
        shapely.box(ROOM * i + 0.05, ROOM * j + 0.05, ROOM * (i + 1) - 0.05, ROOM * (j + 1) - 0.05)
        for i in range(rooms_x)
        for j in range(rooms_y)
    ]
    doors = [
        shapely.box(ROOM * i - 0.1, ROOM * (j + 0.5) - 0.5, ROOM * i + 0.1, ROOM * (j + 0.5) + 0.5)
        for i in range(1, rooms_x)
        for j in range(rooms_y)
    ] + [
        shapely.box(ROOM * (i + 0.5) - 0.5, ROOM * j - 0.1, ROOM * (i + 0.5) + 0.5, ROOM * j + 0.1)
        for i in range(rooms_x)
        for j in range(1, rooms_y)
    ]
    free = shapely.union_all(rooms + doors)
    assert isinstance(free, shapely.Polygon)
    named = tuple(Room("Office", room) for room in rooms)
    return FloorPlan(f"{rooms_x}x{rooms_y}", free, named, (), "benchmark")


def cases() -> list[Case]:
    """Open space with more and more walls; then contact, furniture and people."""
    robot = RobotConfig()
    circle = Twist2D(0.2, 0.4)  # a circle of 0.5 m radius: never near a wall of the room
    middle = Pose2D(2.0, 1.5, 0.0)
    small, medium, large = building(2, 2), building(3, 2), building(10, 9)
    clutter = make_clutter(medium, np.random.default_rng(1), ClutterConfig(furniture=1.0), robot)
    people = make_clutter(medium, np.random.default_rng(1), ClutterConfig(people=3), robot)
    away = sample_start(medium, robot, np.random.default_rng(2), people)
    return [
        Case("open space", World(small, robot), middle, circle),
        Case("open space", World(medium, robot), middle, circle),
        Case("open space", World(large, robot), middle, circle),
        Case("open space, furniture", World(medium, robot, clutter=clutter), middle, circle),
        Case("three people walking", World(medium, robot, clutter=people), away, Twist2D(0.0, 0.4)),
        Case("pressing on a wall", World(medium, robot), middle, Twist2D(0.26, 0.0)),
    ]


def measure(case: Case) -> dict[str, object]:
    """One row."""
    rng = np.random.default_rng(0)
    world = case.world
    lidar, odometry = Lidar(LidarConfig()), WheelOdometry(OdometryConfig(), world.robot, rng)
    world.reset(case.start)
    for _ in range(100):
        motion = world.step(case.command, DT)
    step = cpu_microseconds(lambda: world.step(case.command, DT))
    scan = cpu_microseconds(lambda: lidar.scan(world.pose, world.segments(), rng, 0.0))
    integrate = cpu_microseconds(lambda: odometry.update(motion, rng))
    build = cpu_microseconds(lambda: World(world.building.plan, world.robot).reset(case.start))
    choose = cpu_microseconds(lambda: sample_start(world.building.plan, world.robot, rng))
    return {
        "world": case.name,
        "segments": len(world.segments()),
        "step [us]": step,
        "scan [us]": scan,
        "odometry [us]": integrate,
        "all three [us]": step + scan + integrate,
        "new world [us]": build,
        "choose a start [us]": choose,
    }


def main() -> None:
    argparse.ArgumentParser(description=__doc__).parse_args()
    rows = [measure(case) for case in cases()]
    columns = list(rows[0])
    times = [column for column in columns if "[us]" in column]
    print_and_save(
        "simulation/world_step",
        "A control step of 0.2 s, one core, CPU time",
        rows,
        columns,
        MODULES,
        times,
    )


if __name__ == "__main__":
    main()
