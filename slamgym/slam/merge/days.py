"""The map of several drives, the newest last: what has changed is drawn as it is now.

A cell that one drive saw occupied and a later one free, or the other way, has changed: what was counted before says
nothing any more. What is gone goes at once. What comes where floor was free is drawn once a second drive has seen it:
it may be a person. Where drives agree all count together.
"""

import cv2
import numpy as np

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, BoolArray, ByteArray, OccupancyGrid
from slamgym.slam.graph.map_graph import MapGraph

BESIDE_SURFACE = 0.1
"""A cell so near to a surface isn't free of it [m]: drives join to within some centimetres."""


def draw_days(graph: MapGraph) -> OccupancyGrid:
    """Draw the map of a graph whose drives are in the order of time, with the cells of the first."""
    if len(graph.drives) == 1:
        return graph.grid()
    whole = graph.counted(*graph.drives)
    days = [graph.counted(drive) for drive in graph.drives]
    for day in days:
        day.cover(whole.box)
    votes = np.stack([_vote(day.classified(), day.resolution) for day in days])
    counts = np.stack([day.counts for day in days])
    whole.counts[:] = np.where(count_now(votes)[..., None], counts, 0).sum(axis=0)
    return whole.occupancy_grid()


def _vote(cells: ByteArray, resolution: float) -> ByteArray:
    """What a drive says of cells; nothing of free ones beside a surface."""
    votes = cells.copy()
    votes[(cells == FREE) & ~are_clear(cells, resolution)] = UNKNOWN
    return votes


def are_clear(cells: ByteArray, resolution: float) -> BoolArray:
    """Free cells with no occupied one beside them."""
    reach = round(BESIDE_SURFACE / resolution)
    around = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    beside = cv2.dilate((cells == OCCUPIED).astype(np.uint8), around)
    return np.asarray((cells == FREE) & (beside == 0))


def count_now(votes: ByteArray) -> BoolArray:
    """Which drives still count where.

    Args:
        votes: What each drive says of each cell, shape (drives, rows, cols), the oldest first.

    Returns:
        True where a drive's counts go into the map, of the same shape.
    """
    counts = np.ones(votes.shape, dtype=bool)
    known = np.full(votes.shape[1:], UNKNOWN, np.uint8)
    waiting = np.full(known.shape, -1)  # the drive that has seen something come
    for number, vote in enumerate(votes):
        is_gone = (vote == FREE) & (known == OCCUPIED)
        counts[:number, is_gone] = False
        has_come = (vote == OCCUPIED) & (known == FREE)
        is_second = has_come & (waiting >= 0)
        counts[:number, is_second] = False
        rows, cols = np.nonzero(is_second)
        counts[waiting[rows, cols], rows, cols] = True
        is_first = has_come & ~is_second
        counts[number, is_first] = False
        says = (vote != UNKNOWN) & ~is_first
        known[says] = vote[says]
        waiting[says] = -1
        waiting[is_first] = number
    return counts
