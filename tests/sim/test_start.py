import numpy as np
import pytest
import shapely

from slamgym.cad.floorplan import FloorPlan
from slamgym.core.errors import PlanError
from slamgym.sim import ClutterConfig, RobotConfig, World, make_clutter, sample_start


def test_a_sampled_start_is_always_accepted(make_random_plan):
    robot = RobotConfig()
    for seed in range(30):
        rng = np.random.default_rng(seed)
        plan = make_random_plan(rng)
        try:
            start = sample_start(plan, robot, rng)
        except PlanError:
            assert plan.free_space.buffer(-robot.radius - 0.05).is_empty
            continue
        World(plan, robot).reset(start)


def test_it_keeps_off_furniture_and_people(flat):
    robot = RobotConfig()
    for seed in range(20):
        rng = np.random.default_rng(seed)
        clutter = make_clutter(flat, rng, ClutterConfig(furniture=1.0, people=3), robot)
        World(flat, robot, clutter=clutter).reset(sample_start(flat, robot, rng, clutter))


def test_it_is_drawn_evenly_over_the_area(hall):
    rng = np.random.default_rng(0)
    poses = np.array([sample_start(hall, RobotConfig(), rng) for _ in range(2000)])
    # Means of even draws over 7.5 m, 5.5 m and a turn: 4.5 standard errors of the mean of 2,000.
    assert poses.mean(axis=0) == pytest.approx(
        [4.0, 3.0, 0.0], abs=4.5 * 2 * np.pi / np.sqrt(12 * 2000)
    )
    assert np.ptp(poses, axis=0) == pytest.approx([7.5, 5.5, 2 * np.pi], abs=0.1)


def test_it_is_never_in_an_enclosed_region_that_the_robot_can_not_leave():
    # A small room behind a gap of 0.4 m, too narrow for the robot.
    free = shapely.union_all(
        [shapely.box(0, 0, 4, 4), shapely.box(4, 1, 4.2, 1.4), shapely.box(4.2, 0, 6, 2)]
    )
    plan = FloorPlan("enclosed", free)
    starts = [sample_start(plan, RobotConfig(), np.random.default_rng(seed)) for seed in range(50)]
    assert max(start.x for start in starts) < 4.0


def test_a_plan_in_which_the_robot_fits_nowhere_is_refused_by_name():
    with pytest.raises(PlanError, match="slot"):
        sample_start(
            FloorPlan("slot", shapely.box(0, 0, 0.4, 5)), RobotConfig(), np.random.default_rng(0)
        )
