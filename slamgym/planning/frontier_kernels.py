"""Kernels of the search for frontiers: open cells near by, the flood, and groups of frontier cells."""

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import BoolArray, ByteArray, Float32Array, Int32Array, IntArray
from slamgym.planning.costmap import LETHAL_COST

ANY: BoolArray = np.zeros(0, dtype=np.bool_)
"""Mask for :func:`nearest_open_cell` that omits no cell."""


@kernel
def find_centres(
    cells: Int32Array, row: float, col: float
) -> tuple[tuple[float, float], int, int, float]:
    """Mean of some cells (N, 2), which is nearest to a place and which to the mean, and how near squared [cells^2]."""
    count = len(cells)
    rows = 0.0
    cols = 0.0
    nearest = 0
    near = np.inf
    for i in range(count):
        rows += cells[i, 0]
        cols += cells[i, 1]
        squared = (cells[i, 0] - row) ** 2 + (cells[i, 1] - col) ** 2
        if squared < near:
            near = squared
            nearest = i
    rows /= count
    cols /= count
    middle = 0
    least = np.inf
    for i in range(count):
        squared = (cells[i, 0] - rows) ** 2 + (cells[i, 1] - cols) ** 2
        if squared < least:
            least = squared
            middle = i
    return (rows, cols), nearest, middle, near


@kernel
def farthest_from_walls(distance: Float32Array, cells: Int32Array) -> float:
    """The largest distance of some cells (N, 2) from an obstacle, of a costmap's (H, W) [cells]."""
    farthest = np.float32(0.0)
    for i in range(len(cells)):
        farthest = max(farthest, distance[cells[i, 0], cells[i, 1]])
    return float(farthest)


@kernel
def nearest_open_cell(
    costs: ByteArray, row: int, col: int, limit: int, mask: BoolArray, max_steps: int
) -> int:
    """Flat index of the nearest cell with a cost below ``limit``; -1 if there is none.

    The search spreads 8-connected from a cell and doesn't cross lethal cells, so that it never ends on the
    other side of a wall. Among the cells found it takes the one nearest in a straight line.

    Args:
        costs: Costmap, shape (H, W).
        row: Where the search begins.
        col: Where the search begins.
        limit: The cell found costs less than this.
        mask: The cell found must be in it, shape (H * W,); of shape (0,) for any cell.
        max_steps: How far to search [cells].
    """
    height, width = costs.shape
    if row < 0 or row >= height or col < 0 or col >= width:
        return -1
    # What the search can come to: its marks, and its queue, are no larger than that.
    top = max(0, row - max_steps - 1)
    left = max(0, col - max_steps - 1)
    span = min(width, col + max_steps + 2) - left
    cells = (min(height, row + max_steps + 2) - top) * span
    seen = np.zeros(cells, np.bool_)
    queue = np.empty(cells, np.int32)
    queue[0] = row * width + col
    seen[(row - top) * span + col - left] = True
    head = 0
    tail = 1
    end = 1
    best = np.inf
    found = -1
    ring = 0
    while head < end and ring <= max_steps:
        while head < end:
            cell = queue[head]
            head += 1
            r = cell // width
            c = cell % width
            if costs[r, c] < limit and (mask.size == 0 or mask[cell]):
                squared = (r - row) ** 2 + (c - col) ** 2
                if squared < best:
                    best = squared
                    found = cell
                continue
            for dr in range(-1, 2):
                for dc in range(-1, 2):
                    rr = r + dr
                    cc = c + dc
                    if rr < 0 or rr >= height or cc < 0 or cc >= width:
                        continue
                    mark = (rr - top) * span + cc - left
                    if not seen[mark] and costs[rr, cc] != LETHAL_COST:
                        seen[mark] = True
                        queue[tail] = rr * width + cc
                        tail += 1
        end = tail
        ring += 1
        if ring * ring > best:
            break  # all farther rings are farther in a straight line too
    return found


@kernel
def nearest_open_cells(costs: ByteArray, rows: IntArray, cols: IntArray, limit: int) -> IntArray:
    """:func:`nearest_open_cell` of cells, however far, shape (N,)."""
    found = np.empty(len(rows), np.int64)
    for i in range(len(rows)):
        found[i] = nearest_open_cell(costs, rows[i], cols[i], limit, ANY, costs.size)
    return found


@kernel
def flood(costs: ByteArray, start: int, limit: int) -> tuple[Int32Array, BoolArray]:
    """Breadth-first, 4-connected search from a cell.

    Args:
        costs: Costmap, shape (H, W).
        start: Flat index of the first cell.
        limit: Cells below this cost are entered, where the robot's centre can be.

    Returns:
        The cells in the order of the search (flat indices), and a mask of them, shape (H * W,).
    """
    height, width = costs.shape
    flat = costs.reshape(-1)
    reached = np.zeros(height * width, np.bool_)
    queue = np.empty(height * width, np.int32)
    queue[0] = start
    reached[start] = True
    head = 0
    tail = 1
    while head < tail:
        cell = queue[head]
        head += 1
        row = cell // width
        col = cell - row * width
        # Written out, because this innermost step is most of the cost of a search; an unsigned index isn't asked
        # whether it counts from the end.
        above = np.uint64(cell - width)
        left = np.uint64(cell - 1)
        right = np.uint64(cell + 1)
        below = np.uint64(cell + width)
        if row > 0 and not reached[above] and flat[above] < limit:
            reached[above] = True
            queue[tail] = above
            tail += 1
        if col > 0 and not reached[left] and flat[left] < limit:
            reached[left] = True
            queue[tail] = left
            tail += 1
        if col < width - 1 and not reached[right] and flat[right] < limit:
            reached[right] = True
            queue[tail] = right
            tail += 1
        if row < height - 1 and not reached[below] and flat[below] < limit:
            reached[below] = True
            queue[tail] = below
            tail += 1
    return queue[:tail], reached


@kernel
def collect_frontiers(
    edge: BoolArray, order: Int32Array, min_size: float
) -> tuple[Int32Array, IntArray]:
    """Group the frontier cells next to the flooded ones, 8-connected.

    Args:
        edge: Mask from :func:`frontier_cells`, shape (H, W); cells are taken out as they are grouped.
        order: Flooded cells (flat indices) in the order of the search, at least those next to unknown ones.
        min_size: Frontiers of fewer cells are dropped.

    Returns:
        Frontier cells (flat indices), frontier after frontier, the first-contact cell first, and the position
        where each frontier begins, with the end appended.
    """
    height, width = edge.shape
    left = edge.reshape(-1)
    members = np.empty(height * width, np.int32)
    starts = np.empty(height * width + 1, np.int64)
    count = 0
    end = 0
    for position in range(len(order)):
        cell = order[position]
        row = cell // width
        col = cell % width
        for dr, dc in ((-1, 0), (0, -1), (0, 1), (1, 0)):
            r = row + dr
            c = col + dc
            if r < 0 or r >= height or c < 0 or c >= width:
                continue
            seed = r * width + c
            if not left[seed]:
                continue
            first = end
            members[end] = seed
            left[seed] = False
            end += 1
            head = first
            while head < end:
                rr = members[head] // width
                cc = members[head] % width
                head += 1
                for er in range(-1, 2):
                    for ec in range(-1, 2):
                        nr = rr + er
                        nc = cc + ec
                        if nr < 0 or nr >= height or nc < 0 or nc >= width:
                            continue
                        neighbour = nr * width + nc
                        if left[neighbour]:
                            left[neighbour] = False
                            members[end] = neighbour
                            end += 1
            if end - first >= min_size:
                starts[count] = first
                count += 1
            else:
                end = first
    starts[count] = end
    return members[:end].copy(), starts[: count + 1].copy()
