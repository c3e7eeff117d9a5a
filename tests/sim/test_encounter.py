"""Robots of one building touch and push each other, and drive by themselves where they can't."""

import math

import numpy as np
import pytest

from slamgym.core.types import Pose2D, Twist2D
from slamgym.sim import RobotConfig, World
from slamgym.sim.building import Building
from slamgym.sim.contact import SKIN, ContactSolver
from slamgym.sim.encounter import Encounter

ROBOT = RobotConfig()
STEP = 0.2


def team(plan, *starts):
    """Robots in one building, who know of each other."""
    building = Building(plan)
    worlds = [World(building, ROBOT, others=len(starts) - 1) for _ in starts]
    for world, start in zip(worlds, starts, strict=True):
        world.reset(Pose2D(*start))
    encounter = Encounter(worlds)
    encounter.introduce()
    return worlds, encounter


def drive(encounter, targets, seconds):
    """Drive together; whose motion contact has changed in the last step."""
    for _ in range(round(seconds / STEP)):
        contacts = encounter.drive(targets, STEP)
    return contacts


def apart(worlds):
    return math.dist(worlds[0].state[:2], worlds[1].state[:2])


def test_two_robots_that_meet_head_on_stop_at_each_other(hall):
    worlds, encounter = team(hall, (2.0, 3.0, 0.0), (4.0, 3.0, math.pi))
    targets = [Twist2D(0.26, 0.0)] * 2
    assert not any(drive(encounter, targets, 2.0))
    assert all(drive(encounter, targets, 6.0))
    assert 2 * ROBOT.radius <= apart(worlds) <= 2 * (ROBOT.radius + SKIN)
    middle = np.mean([world.state[0] for world in worlds])
    assert middle == pytest.approx(3.0, abs=1e-3), "neither is stronger"


def test_a_robot_pushes_one_that_stands_at_half_its_speed(hall):
    worlds, encounter = team(hall, (2.0, 3.0, 0.0), (3.0, 3.0, 0.5))
    targets = [Twist2D(0.26, 0.0), Twist2D(0.0, 0.0)]
    assert all(drive(encounter, targets, 4.0))
    before = [world.state.copy() for world in worlds]
    drive(encounter, targets, 2.0)
    for world, old in zip(worlds, before, strict=True):
        assert world.state[0] - old[0] == pytest.approx(0.26, abs=5e-3)
        assert world.state[1] == pytest.approx(3.0, abs=1e-3)
    pushed = worlds[1].state
    assert pushed[2] == pytest.approx(0.5), "a disc isn't turned"
    assert pushed[5] == pushed[6] == 0.0, "its wheels stand"


def test_a_robot_between_another_and_a_wall_stands(hall):
    worlds, encounter = team(hall, (6.5, 3.0, 0.0), (7.5, 3.0, 0.0))
    targets = [Twist2D(0.26, 0.0), Twist2D(0.0, 0.0)]
    drive(encounter, targets, 15.0)
    assert 8.0 - ROBOT.radius - SKIN <= worlds[1].state[0] <= 8.0 - ROBOT.radius
    assert apart(worlds) >= 2 * ROBOT.radius
    before = worlds[0].state[0]
    drive(encounter, targets, 1.0)
    assert worlds[0].state[0] == pytest.approx(before, abs=1e-3)


def test_robots_never_overlap_however_they_drive(hall):
    for seed in range(4):
        rng = np.random.default_rng(seed)
        starts = [(3.0 + 0.47 * k, 3.0, rng.uniform(-3, 3)) for k in range(3)]
        worlds, encounter = team(hall, *starts)
        touched = 0
        for _ in range(60):
            targets = [Twist2D(*rng.uniform((-0.26, -1.8), (0.26, 1.8))) for _ in worlds]
            touched += any(encounter.drive(targets, STEP))
            places = np.array([world.state[:2] for world in worlds])
            distances = np.hypot(*(places[:, None] - places).T)[np.triu_indices(3, 1)]
            assert distances.min() >= 2 * ROBOT.radius - 1e-9
        assert touched


def test_robots_drive_together_as_alone_where_nothing_is_touched(hall):
    worlds, encounter = team(hall, (2.0, 3.0, 0.0), (2.0, 4.0, 0.0))
    alone = World(hall, ROBOT)
    alone.reset(Pose2D(2.0, 3.0, 0.0))
    target = Twist2D(0.2, 0.5)
    for _ in range(20):
        encounter.drive([target, target], STEP)
        alone.step(target, STEP)
    # Pieces of the ramp of another length: the bound of the kernel's own test.
    assert worlds[0].state[:3] == pytest.approx(alone.state[:3], abs=5e-5)


@pytest.mark.parametrize(("gap", "near"), [(0.10, True), (0.11, False)])
def test_only_robots_that_can_reach_each_other_in_a_step_drive_together(hall, gap, near):
    """Both cover 0.052 m in a step, each in its skin."""
    between = 2.0 * (ROBOT.radius + SKIN) + gap
    _, encounter = team(hall, (2.0, 3.0, 0.0), (2.0 + between, 3.0, 0.0))
    assert encounter.is_near([Twist2D(0.26, 0.0)] * 2, STEP) == near


def test_a_robot_is_seen_as_a_cylinder(hall):
    (one, _), encounter = team(hall, (2.0, 3.0, 0.0), (4.0, 3.0, 0.0))
    outline = one.segments()[one.building.num_obstacles :]
    radii = np.hypot(outline[:, 0::2] - 4.0, outline[:, 1::2] - 3.0)
    assert radii == pytest.approx(ROBOT.radius)
    drive(encounter, [Twist2D(0.0, 0.0), Twist2D(0.26, 0.0)], 1.0)
    moved = one.segments()[one.building.num_obstacles :]
    assert (moved[:, 0] > outline[:, 0]).all()


def test_robots_in_a_row_share_a_push():
    robots = [Pose2D(2.0 * k * (ROBOT.radius + 0.5 * SKIN), 0.0, 0.0) for k in range(3)]
    solver = ContactSolver(np.empty((0, 4)), np.empty((0, 3)), ROBOT, 3)
    solved = solver.solve(robots, [(0.3, 0.1, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)])
    # The solver's impulses go to and fro along the row.
    assert [one.left[0] for one in solved] == pytest.approx([0.1] * 3, abs=1e-3)
    assert [one.left[1] for one in solved] == pytest.approx([0.1, 0.0, 0.0], abs=1e-9)
