"""Data association that fails: the term that the paper says its model lacks.

A scan matcher that locks on to the wrong wall puts the robot, and the room it is about to draw, beside its
place; until it recovers nothing corrects the pose. On the map a room jumps, or a wall breaks and is drawn
twice.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from slamgym.core.types import BoolArray, FloatArray, IntArray
from slamgym.parametric.config import FailureConfig
from slamgym.parametric.odometry_error import Increments


@dataclass(frozen=True)
class Failures:
    """When matching fails, and by how much it jumps."""

    scans: IntArray  # (F,) scan at which each failure begins, at least 1
    jumps: FloatArray  # (F, 3) distance [m], lateral [m], turn [rad] of the wrong match
    matched: BoolArray  # (T,) False for scans that nothing corrects

    def disturb(self, believed: Increments) -> Increments:
        """Believed increments with the wrong matches in them."""
        distance, lateral, turn = believed.distance.copy(), believed.lateral.copy(), believed.turn.copy()
        np.add.at(distance, self.scans - 1, self.jumps[:, 0])
        np.add.at(lateral, self.scans - 1, self.jumps[:, 1])
        np.add.at(turn, self.scans - 1, self.jumps[:, 2])
        return replace(believed, distance=distance, lateral=lateral, turn=turn)


def draw_failures(motion: Increments, config: FailureConfig, rng: np.random.Generator) -> Failures:
    """Draw failures as a Poisson process along the way.

    Args:
        motion: T - 1 true increments.
        config: Rate and size.
        rng: Source of randomness.
    """
    way = np.concatenate([[0.0], np.cumsum(np.abs(motion.distance))])
    count = int(rng.poisson(config.rate * way[-1]))
    places = np.sort(rng.uniform(0.0, way[-1], count))
    scans = np.clip(np.searchsorted(way, places), 1, len(way) - 1)
    sizes = np.array([config.jump, config.jump, math.radians(config.jump_deg)])
    matched = np.ones(len(way), dtype=np.bool_)
    for scan in scans:
        matched[scan : scan + config.skipped_scans] = False
    return Failures(scans, sizes * rng.standard_normal((count, 3)), matched)
