"""Kernels of the global planner: A* and Dijkstra over a costmap, and the cost of a straight line."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamgym.core.jit import assign, kernel
from slamgym.core.types import BoolArray, ByteArray, Float32Array, FloatArray, Int32Array, IntArray

UInt64Array = NDArray[np.uint64]

_SQRT2 = np.float32(1.4142135)

# An entry of the heap is one number: the bits of its key, a positive float32, above those of its cell. Such bits are
# in the order of the floats. All is unsigned, for an unsigned index isn't asked whether it counts from the end.
_ONE = np.uint64(1)
"""One place in the heap, or one bit."""
_HALF = np.uint64(32)
"""Number of bits of an entry's cell, below those of its key."""
_CELL = np.uint64(0xFFFFFFFF)
"""Mask of the bits of an entry's cell."""

_AWAITED = np.uint8(1)
"""Bit of a cell's state: the search may end with it."""
_REACHED = np.uint8(2)
"""Bit of a cell's state: the search came to it."""
_CLOSED = np.uint8(4)
"""Bit of a cell's state: its cost is final."""


@kernel
def _push(heap: UInt64Array, size: Any, entry: Any, key: Any) -> Any:
    """Add to a binary heap, below all whose keys are no larger than ``key``; returns its new size."""
    child = size
    while child > 0:
        parent = (child - _ONE) >> _ONE
        if heap[parent] >> _HALF <= key:
            break
        heap[child] = heap[parent]
        child = parent
    heap[child] = entry
    return size + _ONE


@kernel
def _pop(heap: UInt64Array, size: Any) -> Any:
    """Take the root, already read, off a binary heap; returns its new size.

    The last entry takes its place: the smaller children move up as far as there are some, then the entry climbs from
    the bottom, where it nearly always belongs, so that each level costs one comparison (Wegener 1993).
    """
    size -= _ONE
    entry = heap[size]
    key = entry >> _HALF
    hole = np.uint64(0)
    child = _ONE
    while child < size:
        if child + _ONE < size:
            child += np.uint64(heap[child + _ONE] >> _HALF < heap[child] >> _HALF)
        heap[hole] = heap[child]
        hole = child
        child = (child << _ONE) + _ONE
    while hole > 0:
        parent = (hole - _ONE) >> _ONE
        if heap[parent] >> _HALF < key:
            break
        heap[hole] = heap[parent]
        hole = parent
    heap[hole] = entry
    return size


@kernel
def search_path(
    costs: ByteArray,
    start: int,
    goal: int,
    wanted: IntArray,
    limit: int,
    factor: float,
    enough: int = 1 << 62,
) -> tuple[Float32Array, Int32Array]:
    """A* from a cell to another, 8-connected; with ``goal`` -1 Dijkstra's search over what is reachable.

    A step costs its length times ``1 + factor * cost`` of the cell entered. No step cuts the corner of a cell
    at or above ``limit``.

    Args:
        costs: Costmap, shape (H, W).
        start: Flat index of the first cell.
        goal: Flat index of the only wanted cell, or -1.
        wanted: Flat indices (N,) of the cells that the search may end with.
        limit: Cells at or above this cost are not entered.
        factor: Weight of the costs.
        enough: Dijkstra's search ends with so many of the wanted cells, the cheapest to get to.

    Returns:
        The cost from the start to each wanted cell [cells], shape (N,), inf where the search didn't come; final for as
        many as are enough, others cost no less. And the flat index of each cell's predecessor, shape (H * W,), which
        only cells that it came to have.
    """
    height, width = costs.shape
    flat = costs.reshape(-1)
    # Memory that isn't written to costs nothing, so most of it isn't filled.
    distance = np.empty(height * width, np.float32)
    parent = np.empty(height * width, np.int32)
    state = np.zeros(height * width, np.uint8)
    num_awaited = 0
    for end in wanted:
        num_awaited += int(not state[end] & _AWAITED)
        state[end] |= _AWAITED
    num_awaited = min(num_awaited, enough)
    steps = np.empty(256, np.float32)
    for cost in range(256):
        steps[cost] = 1.0 + factor * cost
    # A cell enters the heap once for each time its distance falls, which is 8 times at most.
    capacity = 4096
    heap = np.empty(capacity, np.uint64)
    single = np.zeros(1, np.float32)
    bits = single.view(np.uint32)
    goal_row = goal // width
    goal_col = goal % width
    distance[start] = 0.0
    state[start] |= _REACHED
    size = _push(heap, np.uint64(0), np.uint64(start), np.uint64(0))
    while size > 0:
        cell = np.int64(heap[0] & _CELL)
        size = _pop(heap, size)
        here = np.uint64(cell)
        if state[here] & _CLOSED:
            continue
        state[here] |= _CLOSED
        num_awaited -= int(state[here] & _AWAITED)
        if num_awaited == 0:
            break
        row = cell // width
        col = cell % width
        if np.int64(size) + 8 > capacity:
            grown = np.empty(2 * capacity, np.uint64)
            assign(heap, grown[:capacity])
            heap = grown
            capacity = 2 * capacity
        so_far = distance[here]
        for dr in range(-1 if row > 0 else 0, 2 if row < height - 1 else 1):
            for dc in range(-1 if col > 0 else 0, 2 if col < width - 1 else 1):
                neighbour = np.uint64(cell + dr * width + dc)
                # Closed is the cell itself, too.
                if state[neighbour] & _CLOSED or flat[neighbour] >= limit:
                    continue
                length = np.float32(1.0)
                if dr != 0 and dc != 0:
                    beside = np.uint64(cell + dc)
                    above = np.uint64(cell + dr * width)
                    if flat[above] >= limit or flat[beside] >= limit:
                        continue
                    length = _SQRT2
                reached = so_far + length * steps[flat[neighbour]]
                if not state[neighbour] & _REACHED or reached < distance[neighbour]:
                    state[neighbour] |= _REACHED
                    distance[neighbour] = reached
                    parent[neighbour] = cell
                    key = np.float64(reached)
                    if goal >= 0:
                        down = abs(row + dr - goal_row)
                        across = abs(col + dc - goal_col)
                        key += max(down, across) + (_SQRT2 - np.float32(1.0)) * min(down, across)
                    single[0] = key
                    kept = np.uint64(bits[0])
                    # A key that was rounded up stays behind those that are larger than what it was.
                    compared = kept - _ONE if single[0] > key else kept
                    size = _push(heap, size, (kept << _HALF) | neighbour, compared)
    lengths = np.where(state[wanted] & _REACHED, distance[wanted], np.float32(np.inf))
    return lengths, parent


@kernel
def search_lengths(
    costs: ByteArray,
    cells: IntArray,
    anew: IntArray,
    limit: int,
    size: np.float32,
    lengths: FloatArray,
) -> None:
    """Search the paths from some of N cells to all, and shorten those between others that lead by way of them.

    Args:
        costs: As for :func:`search_path`, like the limit.
        cells: Flat indices, -1 for one that no path leads to, shape (N,).
        anew: From which of them the paths are searched, shape (M,).
        limit: See there.
        size: Of a cell, in single precision [m].
        lengths: Between all, shape (N, N) [m]; written to.
    """
    count = len(cells)
    for i in anew:
        own = np.full(count, np.inf, np.float32)
        if cells[i] >= 0:
            own[:] = search_path(costs, cells[i], -1, cells, limit, 0.0)[0] * size
        lengths[i] = own
        lengths[:, i] = own
        by_way_of_i = lengths[i] + lengths[i].reshape(-1, 1)
        lengths[:, :] = np.minimum(lengths, by_way_of_i)


@kernel
def trace_path(parent: Int32Array, start: int, goal: int) -> IntArray:
    """Cells (flat indices) from the start to the goal by the predecessors."""
    length = 1
    cell = goal
    while cell != start:
        cell = parent[cell]
        length += 1
    path = np.empty(length, np.int64)
    cell = goal
    for i in range(length - 1, -1, -1):
        path[i] = cell
        cell = parent[cell]
    return path


@kernel
def line_cost(
    costs: ByteArray, row0: float, col0: float, row1: float, col1: float, limit: int, factor: float
) -> float:
    """Cost of a straight line [cells], sampled twice per cell; inf if it meets a cell at or above ``limit``.

    Coordinates are those of cell centres; the first point's own cell is not looked at.
    """
    height, width = costs.shape
    length = np.hypot(row1 - row0, col1 - col0)
    steps = max(1, int(np.ceil(2.0 * length)))
    total = 0.0
    for i in range(1, steps + 1):
        share = i / steps
        row = int(np.floor(row0 + share * (row1 - row0) + 0.5))
        col = int(np.floor(col0 + share * (col1 - col0) + 0.5))
        if row < 0 or row >= height or col < 0 or col >= width or costs[row, col] >= limit:
            return np.inf
        total += 1.0 + factor * costs[row, col]
    return total * length / steps


@kernel
def shortcut(costs: ByteArray, path: FloatArray, limit: int, factor: float) -> BoolArray:
    """Which points of a path to keep so that straight lines between them cost no more than the path did.

    Args:
        costs: Costmap, shape (H, W).
        path: Points (row, col), shape (N, 2).
        limit: As in :func:`search_path`.
        factor: As in :func:`search_path`.
    """
    n = len(path)
    along = np.zeros(n)
    for i in range(1, n):
        step = line_cost(costs, path[i - 1, 0], path[i - 1, 1], path[i, 0], path[i, 1], 256, factor)
        along[i] = along[i - 1] + step
    keep = np.zeros(n, np.bool_)
    keep[0] = True
    i = 0
    while i < n - 1:
        # Doubling steps forward: paths are mostly straight, so this finds long lines with few tests.
        best = i + 1
        stride = 2
        while stride >= 1 and best < n - 1:
            j = min(n - 1, best + stride)
            line = line_cost(costs, path[i, 0], path[i, 1], path[j, 0], path[j, 1], limit, factor)
            if line <= along[j] - along[i] + 1e-9:
                best = j
                stride *= 2
            else:
                stride //= 2
                if stride > 4:
                    stride = 4
        keep[best] = True
        i = best
    return keep
