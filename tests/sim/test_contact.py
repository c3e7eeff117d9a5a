"""Contacts: what touches nothing isn't changed, what touches is stopped, and no solver is made before."""

import math

import numpy as np
import pytest

from slamgym.cad import FloorPlan
from slamgym.core.types import Pose2D, Twist2D
from slamgym.sim import RobotConfig, World, sample_start
from slamgym.sim import building as building_module
from slamgym.sim.contact import SKIN, ContactSolver

WALL = np.array([[1.0, -5.0, 1.0, 5.0]])
NOBODY = np.empty((0, 3))


@pytest.mark.parametrize("gap", [0.0, 0.001, 0.02])
def test_a_wish_is_left_as_it_is_where_nothing_is_touched(gap):
    robot = RobotConfig()
    solver = ContactSolver(WALL, NOBODY, robot)
    pose = Pose2D(1.0 - robot.radius - SKIN - gap - 1e-9, 0.3, 0.4)
    wish = (0.2, -0.1, 1.5)
    ((left, push),) = solver.solve([pose], [wish])
    assert left == pytest.approx(wish, abs=1e-12)
    assert push == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)


def test_a_wall_takes_the_part_of_a_velocity_that_goes_into_it():
    robot = RobotConfig()
    solver = ContactSolver(WALL, NOBODY, robot)
    pose = Pose2D(1.0 - robot.radius - 0.5 * SKIN, 0.3, 0.4)
    ((left, push),) = solver.solve([pose], [(0.2, -0.1, 1.5)])
    assert left == pytest.approx((0.0, -0.1, 1.5), abs=1e-6)
    assert push[0] < 0.0, "the overlap of the skin ends"
    ((away, _),) = solver.solve([pose], [(-0.2, 0.1, 0.0)])
    assert away == pytest.approx((-0.2, 0.1, 0.0), abs=1e-6)


def test_the_push_of_an_old_contact_is_not_felt_at_the_next_one():
    robot = RobotConfig()
    walls = np.vstack([WALL, WALL - [2.0, 0.0, 2.0, 0.0]])
    used, fresh = (ContactSolver(walls, NOBODY, robot) for _ in range(2))
    used.solve([Pose2D(1.0 - robot.radius - 0.1 * SKIN, 0.0, 0.0)], [(0.2, 0.0, 0.0)])
    used.release()
    there = [Pose2D(-1.0 + robot.radius + 0.9 * SKIN, 0.0, 0.0)], [(-0.2, 0.0, 0.0)]
    for one, other in zip(used.solve(*there)[0], fresh.solve(*there)[0], strict=True):
        # The overlap is looked for where that push of 0.05 m/s led for a hundredth of a second.
        assert one == pytest.approx(other, abs=5e-3)


def test_a_disc_that_moves_up_is_a_wall_too():
    robot = RobotConfig()
    solver = ContactSolver(np.empty((0, 4)), np.array([[9.0, 9.0, 0.25]]), robot)
    solver.place_discs(np.array([[robot.radius + 0.25, 0.0, 0.25]]))
    ((left, _),) = solver.solve([Pose2D(0.0, 0.0, 0.0)], [(0.2, 0.1, 0.0)])
    assert left == pytest.approx((0.0, 0.1, 0.0), abs=1e-6)


def test_a_robot_that_touches_nothing_never_enters_the_solver(hall: FloorPlan, monkeypatch):
    def refuse(*_):
        raise AssertionError("a solver was made")

    monkeypatch.setattr(building_module, "ContactSolver", refuse)
    world = World(hall, RobotConfig())
    world.reset(Pose2D(2.0, 0.22 + SKIN + 1e-6, 0.0))
    for _ in range(50):  # along a wall, a micrometre off
        assert not world.step(Twist2D(0.26, 0.0), 0.2).contact
    with pytest.raises(AssertionError, match="solver"):
        world.step(Twist2D(0.26, -0.5), 10.0)


def test_contacts_are_the_same_whatever_the_length_of_the_steps(make_random_plan):
    """Of one drive into whatever is ahead, to the skin: the looks at contacts fall on other moments."""
    plan = make_random_plan(np.random.default_rng(2))
    start = sample_start(plan, RobotConfig(), np.random.default_rng(1))
    ends = []
    for dt in (0.02, 0.2, 10.0):
        world = World(plan, RobotConfig())
        world.reset(start)
        for _ in range(round(20.0 / dt)):
            world.step(Twist2D(0.26, 0.0), dt)
        ends.append(world.pose)
    assert math.dist(ends[0][:2], ends[1][:2]) < SKIN
    assert math.dist(ends[0][:2], ends[2][:2]) < SKIN
