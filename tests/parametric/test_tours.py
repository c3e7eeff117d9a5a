"""Tours over a roadmap: every room that the robot fits into is entered, the others are named."""

import numpy as np
import pytest
import shapely

from slamgym.cad import generate_plan, open_plans
from slamgym.cad.floorplan import FloorPlan, Room
from slamgym.parametric.tours import plan_trajectory, rooms_left_out
from slamgym.sim.robot import RobotConfig

BUNDLED = open_plans("bundled")
RASTER = 0.015
"""What a raster of 5 cm may take from a doorway that lies across it [m]."""


def rooms_within_reach(plan: FloorPlan) -> list[Room]:
    """Rooms into which the robot's centre can come from the largest part of the plan."""
    free = plan.free_space.buffer(-RobotConfig.radius - RASTER)
    largest = max(getattr(free, "geoms", [free]), key=lambda part: part.area)
    return [room for room in plan.rooms if largest.intersects(room.polygon)]


def check_tour(plan: FloorPlan, seed: int) -> None:
    tour = plan_trajectory(plan, np.random.default_rng(seed))
    x, y, _ = tour.poses.T
    entered = [room for room in plan.rooms if shapely.intersects_xy(room.polygon, x, y).any()]
    missed = [room.category for room in rooms_within_reach(plan) if room not in entered]
    assert not missed, f"{plan.id}: {missed}"
    assert len(rooms_left_out(plan, tour)) == len(plan.rooms) - len(entered)
    path = shapely.LineString(tour.poses[:, :2])
    # Between cells the distance from walls is interpolated, millimetres off at corners.
    assert path.distance(plan.free_space.boundary) > RobotConfig.radius - 0.01


@pytest.mark.parametrize("plan_id", BUNDLED.ids)
def test_tours_of_bundled_plans_enter_every_room(plan_id) -> None:
    check_tour(BUNDLED.load(plan_id), seed=0)


@pytest.mark.parametrize("seed", range(12))
def test_tours_of_generated_plans_enter_every_room(seed) -> None:
    check_tour(generate_plan(np.random.default_rng(seed)), seed)


def test_a_room_behind_a_gap_that_is_too_narrow_is_named() -> None:
    wall = shapely.box(3.0, 0.0, 3.1, 3.6)  # leaves 40 cm, less than the robot's 44
    rooms = (
        Room("Bedroom", shapely.box(0.0, 0.0, 3.0, 4.0)),
        Room("Bath", shapely.box(3.1, 0.0, 5.0, 4.0)),
    )
    plan = FloorPlan("narrow", shapely.box(0.0, 0.0, 5.0, 4.0).difference(wall), rooms)
    tour = plan_trajectory(plan, np.random.default_rng(0))
    assert rooms_left_out(plan, tour) == ["Bath at (4.0, 2.0)"]


def test_a_tour_leads_through_the_middle_of_each_room() -> None:
    wall = shapely.box(3.0, 0.0, 3.1, 3.0)
    rooms = (
        Room("Bedroom", shapely.box(0.0, 0.0, 3.0, 4.0)),
        Room("Bath", shapely.box(3.1, 0.0, 5.1, 4.0)),
    )
    plan = FloorPlan("open", shapely.box(0.0, 0.0, 5.1, 4.0).difference(wall), rooms)
    path = shapely.LineString(plan_trajectory(plan, np.random.default_rng(0)).poses[:, :2])
    for room in rooms:
        assert path.distance(room.polygon.centroid) < 0.05  # a cell
