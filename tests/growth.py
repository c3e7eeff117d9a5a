"""How much longer something takes with four times the input: at most 2.5 times 2.5 where the cost is nearly linear."""

import math
import time
from collections.abc import Callable

MOST = 6.25
"""Two doublings that cost 2.5 times each; what is quadratic costs 16 times."""


def growth(run: Callable[[int], object], size: int) -> float:
    """CPU time of ``run(4 * size)`` over that of ``run(size)``; what is compiled or read once is done before.

    Both are measured in the same moment, as a machine's speed changes, and again where it is too much: what else the
    machine does only adds, and it adds most to the long one.
    """
    least = math.inf
    for _ in range(10):
        small = min(_seconds(run, size) for _ in range(3))
        least = min(least, _seconds(run, 4 * size) / small)
        if least < MOST:
            break
    return least


def _seconds(run, size):
    began = time.process_time()
    run(size)
    return time.process_time() - began
