"""The kernel for discs among walls gives what pymunk gives, to the bit."""

import numpy as np
import pytest

from slamgym.core.types import Pose2D
from slamgym.sim.contact import ContactSolver, DiscBody, DiscContacts, solve_disc, wall_order
from slamgym.sim.robot import RobotConfig


def scattered_walls(rng):
    """Short walls in a square, some of them in corners that share a point, one without length."""
    walls = rng.uniform(-1.5, 1.5, (60, 4))
    walls[:, 2:] = walls[:, :2] + rng.normal(0.0, 0.4, (60, 2))
    walls[10:20, :2] = walls[:10, 2:]
    walls[20:30] = np.round(walls[20:30], 1)
    walls[5, 2:] = walls[5, :2]
    return walls


@pytest.mark.parametrize("seed", range(6))
def test_velocities_and_pushes_are_pymunks(seed):
    rng = np.random.default_rng(seed)
    robot, walls = RobotConfig(radius=rng.uniform(0.1, 0.3)), scattered_walls(rng)
    solver, disc = ContactSolver(walls, np.empty((0, 3)), robot), DiscBody.of(robot)
    contacts, row = DiscContacts.none(2, len(walls)), seed % 2
    contacts.order[row] = wall_order(walls)
    state = np.zeros(8)
    state[:3] = rng.uniform(-1.0, 1.0, 3)
    held = 0
    for step in range(800):
        wish = tuple(rng.normal(0.0, (0.2, 0.2, 1.0)).tolist())
        expected = solver.solve(Pose2D(*state[:3].tolist()), wish)
        assert solve_disc(contacts, row, walls, disc, state, wish) == expected, step
        left, push = np.array(expected)
        held += bool(np.abs(left - wish).max() > 1e-3)
        # Mostly on by what is left, so that contacts last; now and then elsewhere, so that they are forgotten.
        state[:3] += (left + push) * 0.03 if step % 50 else rng.uniform(-0.3, 0.3, 3)
    assert held > 100
