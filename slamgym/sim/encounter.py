"""Robots of one building that come so near to each other that they could touch."""

from collections.abc import Sequence

import numpy as np

from slamgym.core.types import FloatArray, Twist2D
from slamgym.sim import motion
from slamgym.sim.building import Contacts
from slamgym.sim.contact import SKIN
from slamgym.sim.space import World


class Encounter:
    """Drives the robots of a building together, by substeps in which pymunk decides on all contacts at once.

    Robots that can't reach each other within a step drive by themselves, as if alone in the building.

    Args:
        worlds: Each robot in the same building.
    """

    def __init__(self, worlds: Sequence[World]) -> None:
        first = worlds[0]
        self._worlds = worlds
        self._contacts = Contacts(first.building, first.robot, len(worlds))
        self._touching = 2.0 * (first.robot.radius + SKIN)
        self._pairs = np.triu_indices(len(worlds), k=1)

    def bodies(self) -> FloatArray:
        """The robots with their skin, shape (K, 3) as x, y, radius [m]."""
        return np.array([world.body for world in self._worlds])

    def introduce(self) -> None:
        """Tell each robot where the others are."""
        bodies = self.bodies()
        for k, world in enumerate(self._worlds):
            world.place_others(np.delete(bodies, k, axis=0))

    def is_near(self, targets: Sequence[Twist2D], dt: float) -> bool:
        """True if two robots could touch each other within a time [s], else the last contact is forgotten.

        Args:
            targets: Velocities towards which they drive.
            dt: The time.
        """
        bodies = self.bodies()
        speeds = [
            max(abs(world.state[motion.LINEAR]), abs(target.linear))
            for world, target in zip(self._worlds, targets, strict=True)
        ]
        reach = np.array(speeds) * dt
        one, other = self._pairs
        apart = np.hypot(*(bodies[one, :2] - bodies[other, :2]).T)
        near = bool((apart < self._touching + reach[one] + reach[other]).any())
        if not near:
            self._contacts.reset()
        return near

    def drive(self, targets: Sequence[Twist2D], dt: float) -> list[bool]:
        """Drive for a time [s] towards velocities within the limits; whose motion contact has changed."""
        contacts = [False] * len(self._worlds)
        for world in self._worlds:
            world.state[motion.LEFT :] = 0.0
        left = dt
        while left > motion.NO_TIME:
            spans = [
                motion.contact_span(world.state, target.linear)
                for world, target in zip(self._worlds, targets, strict=True)
            ]
            span = min(left, *spans)
            wishes = [
                world.wish(target, span)
                for world, target in zip(self._worlds, targets, strict=True)
            ]
            solved = self._contacts.solve(
                [world.stand for world in self._worlds], [wish.velocity for wish in wishes]
            )
            for k, world in enumerate(self._worlds):
                contacts[k] |= world.settle(wishes[k], solved[k], span)
                self.introduce()
            left -= span
        return contacts
