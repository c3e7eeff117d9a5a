"""Robots and places of the zoo: ten lasers on robots with good and bad wheels, and six kinds of buildings.

The figures of lasers are those of their data sheets, with the time that a turn takes. A data sheet's accuracy holds the
part of a range's error that stays at a place and the random one; it is taken for three standard deviations of both, of
equal size. Mounts are made up, but of the kind that robots have: ahead of the axle or behind it, and turned.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import shapely
from shapely import Polygon

from slamgym.cad import FloorPlan, PlanGeneratorConfig, generate_plan
from slamgym.sim import ClutterConfig, LidarConfig, RobotConfig

FIRST_SEED = 70_000
"""Seed of the first building of each kind; no constant of the package was chosen on these."""
RECESS = 0.1
"""Depth of the recess of a closed door of a corridor [m]."""
CORRIDOR_FLOOR = 80.0
"""Smallest floor of a corridor [m2]; those that are so large lead round in a ring."""
CORRIDOR_OFFICES = (400.0, 900.0)
"""Smallest and largest office whose corridors are taken [m2]."""
LAB_AREA = (120.0, 220.0)
"""Smallest and largest lab [m2]."""
HALL_SIDES = (18.0, 32.0)
"""Shortest and longest side of a hall [m]."""
HALL_PER_BLOCK = 25.0
"""Floor of a hall for each pillar or show case [m2]."""
BLOCK_SIDES = (0.4, 1.8)
"""Shortest and longest side of these [m]."""
BLOCKS_APART = 1.2
"""So far they stand from each other [m]."""

BY_ACCURACY = 1.0 / (3.0 * math.sqrt(2.0))
"""Standard deviation of the random part as a share of the accuracy."""

WAFFLE = RobotConfig()
"""TurtleBot3 Waffle Pi."""
KOBUKI = RobotConfig(
    wheel_separation=0.23,
    max_linear=0.65,
    max_angular=math.pi,
    linear_acceleration=1.0,
    radius=0.18,
)
"""TurtleBot 2 (data sheet: 0.65 m/s, 180 degrees/s, 354 mm wide)."""
PIONEER = RobotConfig(
    wheel_separation=0.33,
    max_linear=0.7,
    max_angular=1.75,
    linear_acceleration=0.5,
    angular_acceleration=1.75,
    radius=0.25,
)
"""Pioneer 3-DX: 455 mm long (operations manual), at the speeds and accelerations that indoor drives have."""
VACUUM = RobotConfig(wheel_separation=0.23, max_linear=0.3, max_angular=1.8, radius=0.17)
"""A robot vacuum cleaner, 340 mm across."""


class Robot(NamedTuple):
    """A robot of the zoo."""

    lidar: LidarConfig
    odometry: str  # name of the level of its errors
    body: RobotConfig


ROBOTS = {
    # The package's own, of a TurtleBot3 with the view ahead that the paper has; a turn takes 0.2 s.
    "lds-01": Robot(LidarConfig(sweep=0.1), "medium", WAFFLE),
    # e-Manual of ROBOTIS, appendix LDS-02: 160-8,000 mm, 3 % (10 mm below 0.3 m), 1 degree, 5 Hz.
    "lds-02": Robot(
        LidarConfig(
            num_beams=360,
            field_of_view_deg=360.0,
            range_min=0.16,
            range_max=8.0,
            sweep=0.199,
            sigma=0.01 * BY_ACCURACY,
            sigma_relative=0.03 * BY_ACCURACY,
        ),
        "low",
        WAFFLE,
    ),
    # Slamtec LD108, RPLIDAR A1M8: 0.15-12 m, 1 % of the distance, 4,000 samples/s, 5.5 Hz. Its cable looks ahead.
    "rplidar-a1": Robot(
        LidarConfig(
            num_beams=720,
            field_of_view_deg=360.0,
            range_min=0.15,
            range_max=12.0,
            rate=5.5,
            mount=(0.0, 0.0, math.pi),
            sweep=0.1815,
            sigma=0.005 * BY_ACCURACY,
            sigma_relative=0.01 * BY_ACCURACY,
        ),
        "high",
        WAFFLE,
    ),
    # Slamtec LD208, RPLIDAR A2M8: 0.2-12 m, 1 % of the distance, 8,000 samples/s, 10 Hz.
    "rplidar-a2": Robot(
        LidarConfig(
            num_beams=800,
            field_of_view_deg=360.0,
            range_min=0.2,
            range_max=12.0,
            rate=10.0,
            mount=(0.1, 0.0, 0.0),
            sweep=0.0998,
            sigma=0.005 * BY_ACCURACY,
            sigma_relative=0.01 * BY_ACCURACY,
        ),
        "medium",
        KOBUKI,
    ),
    # Slamtec SLAMTEC LD (RPLIDAR C1M1): 0.05-12 m, 30 mm, 5,000 samples/s, 10 Hz. Beside the axle, turned left.
    "rplidar-c1": Robot(
        LidarConfig(
            num_beams=500,
            field_of_view_deg=360.0,
            range_min=0.05,
            range_max=12.0,
            rate=10.0,
            mount=(-0.05, 0.06, 0.5 * math.pi),
            sweep=0.0998,
            sigma=0.03 * BY_ACCURACY,
            sigma_relative=0.0,
        ),
        "low",
        KOBUKI,
    ),
    # Slamtec LD310, RPLIDAR S2: 0.05-30 m, 30 mm, 32,000 samples/s, 10 Hz. At a front corner, turned right.
    "rplidar-s2": Robot(
        LidarConfig(
            num_beams=3200,
            field_of_view_deg=360.0,
            range_min=0.05,
            range_max=30.0,
            rate=10.0,
            mount=(0.12, -0.12, -0.25 * math.pi),
            sweep=0.09997,
            sigma=0.03 * BY_ACCURACY,
            sigma_relative=0.0,
        ),
        "ideal",
        PIONEER,
    ),
    # Hokuyo C-42-03320: steps 44 to 725 of 1,024 a turn, 600 rpm, 20-4,095 mm; 10 mm below 1 m, then 1 %.
    "urg-04lx": Robot(
        LidarConfig(
            num_beams=682,
            field_of_view_deg=239.77,
            range_min=0.02,
            range_max=4.095,
            rate=10.0,
            mount=(0.13, 0.0, 0.0),
            sweep=0.0666,
            sigma=0.01 * BY_ACCURACY,
            sigma_relative=0.01 * BY_ACCURACY,
        ),
        "high",
        KOBUKI,
    ),
    # Hokuyo UTM-30LX: steps 0 to 1,080 of 1,440 a turn, 2,400 rpm, 0.1-30 m, 30 mm below 10 m.
    "utm-30lx": Robot(
        LidarConfig(
            num_beams=1081,
            field_of_view_deg=270.0,
            range_min=0.1,
            range_max=30.0,
            rate=40.0,
            mount=(0.15, 0.0, 0.0),
            sweep=0.01875,
            sigma=0.03 * BY_ACCURACY,
            sigma_relative=0.0,
        ),
        "low",
        PIONEER,
    ),
    # SICK LMS 200/291 technical description: 0.5 degrees over 180 in two turns at 75 Hz, 80 m; random error 5 mm,
    # systematic 15 mm, which is as large where that is taken for three standard deviations.
    "sick-lms": Robot(
        LidarConfig(
            num_beams=361,
            field_of_view_deg=180.0,
            range_min=0.05,
            range_max=80.0,
            rate=10.0,
            mount=(0.16, 0.0, 0.0),
            sweep=0.02,
            sigma=0.005,
            sigma_relative=0.0,
        ),
        "high",
        PIONEER,
    ),
    # Konolige et al., A Low-Cost Laser Distance Sensor (ICRA 2008), as Neato's vacuums have it: 0.2-6 m, 1 degree,
    # 30 mm at 6 m; 5 Hz. The turret is at the back.
    "vacuum": Robot(
        LidarConfig(
            num_beams=360,
            field_of_view_deg=360.0,
            range_min=0.2,
            range_max=6.0,
            mount=(-0.1, 0.0, 0.0),
            sweep=0.199,
            sigma=0.003 * BY_ACCURACY,
            sigma_relative=0.005 * BY_ACCURACY,
        ),
        "medium",
        VACUUM,
    ),
}  # fmt: skip
"""Robots by the name of their laser."""


def home(seed: int) -> FloorPlan:
    """A home."""
    return generate_plan(seed, PlanGeneratorConfig(kind="home"))


def office(seed: int) -> FloorPlan:
    """An office floor."""
    return generate_plan(seed, PlanGeneratorConfig(kind="office"))


def lab(seed: int) -> FloorPlan:
    """A small office floor, to be crammed full."""
    config = PlanGeneratorConfig(kind="office", office_area=LAB_AREA)
    return generate_plan(seed, config, f"lab_{seed:06d}")


def corridor(seed: int) -> FloorPlan:
    """The corridor of an office whose doors are closed: all that is seen of a room is the recess of its door."""
    rng = np.random.default_rng(seed)
    config = PlanGeneratorConfig(kind="office", office_area=CORRIDOR_OFFICES)
    while True:
        plan = generate_plan(rng, config)
        ways = [room.polygon for room in plan.rooms if room.category == "Hallway"]
        with_recesses = shapely.union_all(ways).buffer(RECESS, join_style="mitre")
        floor = plan.free_space.intersection(with_recesses)
        if isinstance(floor, Polygon) and floor.area > CORRIDOR_FLOOR:
            return FloorPlan(f"corridor_{seed:06d}", floor)


def hall(seed: int) -> FloorPlan:
    """A hall with pillars and show cases, wider than the generator's rooms."""
    rng = np.random.default_rng(seed)
    width, depth = rng.uniform(*HALL_SIDES, size=2).tolist()
    floor: Polygon = shapely.box(0.0, 0.0, width, depth)
    blocks: list[Polygon] = []
    for _ in range(round(floor.area / HALL_PER_BLOCK)):
        x, y = rng.uniform((0.0, 0.0), (width, depth)).tolist()
        across, along = rng.uniform(*BLOCK_SIDES, size=2).tolist()
        block = shapely.box(x, y, x + across, y + along)
        stands_free = floor.exterior.distance(block) > BLOCKS_APART and floor.contains(block)
        if stands_free and all(block.distance(other) > BLOCKS_APART for other in blocks):
            blocks.append(block)
    free = floor.difference(shapely.union_all(blocks))
    assert isinstance(free, Polygon)
    return FloorPlan(f"hall_{seed:06d}", free)


class Place(NamedTuple):
    """A kind of building, and what stands in it."""

    make: Callable[[int], FloorPlan]  # from a seed
    clutter: ClutterConfig


PLACES = {
    "empty-home": Place(home, ClutterConfig()),
    "full-home": Place(home, ClutterConfig(furniture=1.0, untidiness=0.5, doors=0.5)),
    "office": Place(office, ClutterConfig(furniture=1.0, untidiness=0.3, doors=0.5, people=1)),
    "corridor": Place(corridor, ClutterConfig(people=1)),
    "hall": Place(hall, ClutterConfig(people=2)),
    "lab": Place(lab, ClutterConfig(furniture=2.0, untidiness=1.0)),
}
"""Kinds of places by their names."""
