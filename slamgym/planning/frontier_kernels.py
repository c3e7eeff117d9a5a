"""Kernels of the frontier search: flood the space that the robot can get to, then collect its unknown border."""

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import BoolArray, ByteArray, FloatArray, Int32Array, IntArray

_LETHAL = np.uint8(254)
_NO_INFORMATION = np.uint8(255)


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
    top, left = max(0, row - max_steps - 1), max(0, col - max_steps - 1)
    span = min(width, col + max_steps + 2) - left
    cells = (min(height, row + max_steps + 2) - top) * span
    seen = np.zeros(cells, np.bool_)
    queue = np.empty(cells, np.int32)
    queue[0] = row * width + col
    seen[(row - top) * span + col - left] = True
    head, tail, end = 0, 1, 1
    best, found, ring = np.inf, -1, 0
    while head < end and ring <= max_steps:
        while head < end:
            cell = queue[head]
            head += 1
            r, c = cell // width, cell % width
            if costs[r, c] < limit and (mask.size == 0 or mask[cell]):
                squared = (r - row) ** 2 + (c - col) ** 2
                if squared < best:
                    best, found = squared, cell
                continue
            for dr in range(-1, 2):
                for dc in range(-1, 2):
                    rr, cc = r + dr, c + dc
                    if rr < 0 or rr >= height or cc < 0 or cc >= width:
                        continue
                    mark = (rr - top) * span + cc - left
                    if not seen[mark] and costs[rr, cc] != _LETHAL:
                        seen[mark] = True
                        queue[tail] = rr * width + cc
                        tail += 1
        end = tail
        ring += 1
        if ring * ring > best:
            break  # all farther rings are farther in a straight line too
    return found


@kernel
def flood(costs: ByteArray, start: int, limit: int, descending: bool) -> tuple[Int32Array, BoolArray]:
    """Breadth-first, 4-connected search from a cell.

    Args:
        costs: Costmap, shape (H, W).
        start: Flat index of the first cell.
        limit: Cells below this cost are entered, where the robot's centre can be.
        descending: Explore Lite's own rule instead: a neighbour is entered if it costs no more than the cell.

    Returns:
        The cells in the order of the search (flat indices), and a mask of them, shape (H * W,).
    """
    height, width = costs.shape
    flat = costs.reshape(-1)
    reached = np.zeros(height * width, np.bool_)
    queue = np.empty(height * width, np.int32)
    queue[0] = start
    reached[start] = True
    head, tail = 0, 1
    while head < tail:
        cell = queue[head]
        head += 1
        if descending:
            limit = flat[cell] + 1
        row = cell // width
        col = cell - row * width
        # Written out, because this innermost step is most of the cost of a search; an unsigned index isn't asked
        # whether it counts from the end.
        above, left = np.uint64(cell - width), np.uint64(cell - 1)
        right, below = np.uint64(cell + 1), np.uint64(cell + width)
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
    costs: ByteArray, order: Int32Array, open_cells: BoolArray, min_size: float
) -> tuple[Int32Array, IntArray]:
    """Group the unknown cells beside the flooded ones, 8-connected.

    Args:
        costs: Costmap, shape (H, W).
        order: Flooded cells (flat indices) in the order of the search, at least those beside unknown ones.
        open_cells: Cells that make an unknown 4-neighbour a frontier cell, shape (H * W,).
        min_size: Frontiers of fewer cells are dropped.

    Returns:
        Frontier cells (flat indices), frontier after frontier, the first-contact cell first, and the position
        where each frontier begins, with the end appended.
    """
    height, width = costs.shape
    flat = costs.reshape(-1)
    flagged = np.zeros(height * width, np.bool_)
    members = np.empty(height * width, np.int32)
    starts = np.empty(height * width + 1, np.int64)
    count, end = 0, 0
    for position in range(len(order)):
        cell = order[position]
        row, col = cell // width, cell % width
        for dr, dc in ((-1, 0), (0, -1), (0, 1), (1, 0)):
            r, c = row + dr, col + dc
            if r < 0 or r >= height or c < 0 or c >= width:
                continue
            seed = r * width + c
            if flagged[seed] or not _is_frontier(flat, open_cells, r, c, height, width):
                continue
            first = end
            members[end] = seed
            flagged[seed] = True
            end += 1
            head = first
            while head < end:
                rr, cc = members[head] // width, members[head] % width
                head += 1
                for er in range(-1, 2):
                    for ec in range(-1, 2):
                        nr, nc = rr + er, cc + ec
                        if nr < 0 or nr >= height or nc < 0 or nc >= width:
                            continue
                        neighbour = nr * width + nc
                        if not flagged[neighbour] and _is_frontier(flat, open_cells, nr, nc, height, width):
                            flagged[neighbour] = True
                            members[end] = neighbour
                            end += 1
            if end - first >= min_size:
                starts[count] = first
                count += 1
            else:
                end = first
    starts[count] = end
    return members[:end].copy(), starts[: count + 1].copy()


@kernel
def _is_frontier(flat: ByteArray, open_cells: BoolArray, row: int, col: int, height: int, width: int) -> bool:
    """Whether a cell is unknown and has an open 4-neighbour."""
    cell = row * width + col
    if flat[cell] != _NO_INFORMATION or open_cells[cell]:
        return False
    return (
        (row > 0 and open_cells[cell - width])
        or (col > 0 and open_cells[cell - 1])
        or (col < width - 1 and open_cells[cell + 1])
        or (row < height - 1 and open_cells[cell + width])
    )


@kernel
def describe_frontiers(
    members: Int32Array, starts: IntArray, width: int, row: float, col: float
) -> FloatArray:
    """Size, smallest distance to (row, col), and cells of each frontier, shape (F, 8) [cells].

    Columns: size, smallest distance, centroid row and col, nearest cell's row and col, row and col of the
    frontier's cell nearest to the centroid.
    """
    described = np.empty((len(starts) - 1, 8))
    for f in range(len(starts) - 1):
        first, end = starts[f], starts[f + 1]
        mean_row, mean_col, best = 0.0, 0.0, np.inf
        for i in range(first, end):
            r, c = members[i] // width, members[i] % width
            mean_row += r
            mean_col += c
            squared = (r - row) ** 2 + (c - col) ** 2
            if squared < best:
                best = squared
                described[f, 4], described[f, 5] = r, c
        mean_row /= end - first
        mean_col /= end - first
        described[f, 0] = end - first
        described[f, 1] = np.sqrt(best)
        described[f, 2], described[f, 3] = mean_row, mean_col
        best = np.inf
        for i in range(first, end):
            r, c = members[i] // width, members[i] % width
            squared = (r - mean_row) ** 2 + (c - mean_col) ** 2
            if squared < best:
                best = squared
                described[f, 6], described[f, 7] = r, c
    return described
