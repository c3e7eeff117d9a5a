"""The paper's rule for a robot that is stuck: the ratio of black to white of its map stands still.

Black are the occupied cells and white the free ones. The paper says neither for how long nor how still: the first is a
setting of the exploration, the second is a constant here.
"""

from collections import deque
from collections.abc import Sequence

import numpy as np

from slamgym.core.types import FREE, OCCUPIED, ByteArray
from slamgym.envs.explore_env import ExploreEnv

_STILL = 0.08
"""A ratio that has changed by at most this share of itself stands still: noise of the laser alone changes that of a
standing robot's map by 1 to 5 % within a minute, exploring changes it by 15 % and more."""
MAPS = 10
"""So many maps are looked at, evenly spread, in the time after which a robot counts as stuck."""


def black_to_white(cells: ByteArray) -> float:
    """Ratio of the occupied cells of a map to its free ones; a map without free cells counts as having one."""
    free = int(np.count_nonzero(cells == FREE))
    return float(np.count_nonzero(cells == OCCUPIED) / max(free, 1))


def is_stuck(ratios: Sequence[float], maps: int = MAPS, still: float = _STILL) -> bool:
    """Whether the ratio of black to white has stood still.

    Args:
        ratios: Of maps that were saved one after the other, evenly spread in time.
        maps: The newest ratio is compared with so many before it; while there are fewer, nothing is stuck.
        still: Largest change, as a share of the largest of them.
    """
    if len(ratios) <= maps:
        return False
    newest = np.array(ratios, dtype=np.float64)[-maps - 1 :]
    change = float(newest.max() - newest.min())
    return change <= still * float(newest.max())


class StuckWatch:
    """Looks at the map of an exploration every so often.

    Args:
        patience: Time after which a robot whose map stands still counts as stuck [s].

    Attributes:
        is_stuck: What the last look said.
    """

    def __init__(self, patience: float) -> None:
        self.is_stuck = False
        self._interval = patience / MAPS
        self._next_look = 0.0
        self._ratios: deque[float] = deque(maxlen=MAPS + 1)

    def look(self, env: ExploreEnv) -> bool:
        """Look at the map if it is time to; returns True if the robot is stuck."""
        simulation = env.simulation
        if simulation.time >= self._next_look - 1e-6:
            self._next_look += self._interval
            self._ratios.append(black_to_white(simulation.mapper.occupancy_grid().cells))
            self.is_stuck = is_stuck(self._ratios)
        return self.is_stuck
