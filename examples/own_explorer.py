"""A template for your own explorer: the exploration loop, and a rule that scores the frontiers.

Run it on the benchmark: ``slamgym bench run own_explorer:make --track loops --quick -o out``
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamgym.agents.explorer import FrontierExplorer
from slamgym.planning import ExplorerContext
from slamgym.planning.exploration_loop import ExplorationLoop, ExplorationLoopConfig
from slamgym.planning.promise import Promise


@dataclass(frozen=True)  # what it prints identifies it: its settings belong into fields
class NearAndLong:
    """Prefers near frontiers, and long ones."""

    length_weight: float = 0.5  # metres of path that a metre of frontier is worth

    def __call__(self, loop: ExplorationLoop) -> NDArray[np.float64]:
        """Scores of the candidates, shape (N,); the robot drives to the highest."""
        lengths = np.array([0.05 * len(c.points) for c in loop.candidates])  # cells of 5 cm
        paths = np.array([c.path_length for c in loop.candidates])
        return self.length_weight * lengths - paths


def make(context: ExplorerContext, seed: int, promise: Promise | None) -> FrontierExplorer:  # noqa: ARG001
    """What the benchmark calls, once for each building; ``promise`` says when to stop."""
    return FrontierExplorer(context, NearAndLong(), ExplorationLoopConfig(promise=promise))
