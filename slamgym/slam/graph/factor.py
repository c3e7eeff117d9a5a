"""Symmetric sparse systems of 3 x 3 blocks, factorised in the same order of operations on every processor.

An up-looking L D L^T (Davis 2005, *Algorithm 849*) in plain loops. Nodes between two anchors are eliminated first, in
the order of time: each has few neighbours. The anchors follow by minimum degree.
"""

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_matrix, identity
from scipy.sparse.linalg import splu

from slamgym.core.jit import kernel
from slamgym.core.portable import inverted
from slamgym.core.types import BoolArray, FloatArray, IntArray


class Factor(NamedTuple):
    """L D L^T in an order of elimination; ``M`` blocks."""

    places: IntArray  # (M,) place of each block in the order
    starts: IntArray  # (M + 1,) begin of each column of L
    rows: IntArray  # (nonzeros,)
    lower: FloatArray  # (nonzeros, 3, 3)
    inverse: FloatArray  # (M, 3, 3) inverses of D

    def solve(self, right: FloatArray) -> FloatArray:
        """Solve for right-hand sides (M, 3, K)."""
        columns = np.arange(len(right))
        x = np.empty_like(right)
        x[self.places] = right
        substitute(self.starts, self.rows, self.lower, self.inverse, x, columns, columns)
        return x[self.places]

    def covariance(self, block: int, other: int) -> FloatArray:
        """Covariance (3, 3) of a block with another one; only their ancestors are looked at."""
        of_block = ancestors(self.starts, self.rows, self.places[block])
        of_other = ancestors(self.starts, self.rows, self.places[other])
        x = np.empty((len(self.places), 3, 3))
        x[of_block] = 0.0
        x[of_other] = 0.0
        x[of_other[0]] = np.eye(3)
        substitute(self.starts, self.rows, self.lower, self.inverse, x, of_other, of_block)
        return x[of_block[0]]


class BlockLayout(NamedTuple):
    """Upper triangle by columns, in the order of elimination; its entries are sums of blocks."""

    places: IntArray  # (M,) place of each block of the diagonal in the order
    starts: IntArray  # (M + 1,) begin of each column
    rows: IntArray  # (nonzeros,)
    slots: IntArray  # (blocks,) entry of each block: those off the diagonal, then those on it
    is_turned: BoolArray  # (blocks,) true if it is transposed there

    def factorise(self, blocks: FloatArray) -> Factor:
        """Factorise the matrix whose entries are the sums of blocks (blocks, 3, 3)."""
        entries = np.zeros((len(self.rows), 3, 3))
        add_blocks(entries, self.slots, self.is_turned, blocks)
        parents, starts = find_pattern(self.starts, self.rows)
        filled = fill_factor(self.starts, self.rows, entries, parents, starts)
        return Factor(self.places, starts, *filled)


def make_layout(places: IntArray, first: IntArray, second: IntArray) -> BlockLayout:
    """Lay out blocks off the diagonal between ``first`` (B,) and ``second`` (B,), and one on it for each place (M,)."""
    size = len(places)
    rows = np.append(places[first], places)
    cols = np.append(places[second], places)
    upper_rows = np.minimum(rows, cols)
    upper_cols = np.maximum(rows, cols)
    keys, slots = np.unique(upper_cols * size + upper_rows, return_inverse=True)
    starts = np.searchsorted(keys // size, np.arange(size + 1))
    return BlockLayout(
        places=places, starts=starts, rows=keys % size, slots=slots, is_turned=rows > cols
    )


def rank_anchors(first: IntArray, second: IntArray, anchors: BoolArray) -> IntArray:
    """Rank the anchors (A,) for elimination by minimum degree, once the nodes between them are eliminated in time.

    Args:
        first: (E,) nodes tied to ...
        second: (E,) ... these: one of them is an anchor, or they follow each other.
        anchors: (N,) true for nodes with many edges.
    """
    count = int(anchors.sum())
    number = np.cumsum(anchors) - 1
    anchor, other = np.where(anchors[first], (first, second), (second, first))
    has_anchor = anchors[anchor]
    anchor = anchor[has_anchor]
    other = other[has_anchor]
    # A run of nodes between two anchors is eliminated one after the other: all that they saw become neighbours.
    run: IntArray = np.cumsum(anchors) - anchors
    own = np.arange(count)
    runs = np.concatenate([run[other], own, own + 1])
    seen_anchors = np.concatenate([number[anchor], own, own])
    size = len(runs)
    seen = csr_matrix((np.ones(size), (runs, seen_anchors)), shape=(count + 1, count))
    # Only the order is taken, which depends on the pattern alone.
    diagonal = count * size * identity(count)
    pattern = (seen.T * seen + diagonal).tocsc()
    options = {"SymmetricMode": True}
    ranked = splu(pattern, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
    return np.asarray(ranked.perm_c, dtype=np.int64)


def elimination_order(anchors: BoolArray, ranks: IntArray) -> IntArray:
    """Place of each node in the order of elimination, (N,).

    Args:
        anchors: (N,) true for nodes that are eliminated after the others ...
        ranks: (A,) ... in this order; those without a rank come last.
    """
    places = np.arange(len(anchors))
    count = int(anchors.sum())
    first = len(anchors) - count
    every_rank = np.append(ranks, np.arange(len(ranks), count))
    places -= np.cumsum(anchors)
    places[anchors] = first + every_rank
    return places


@kernel
def add_blocks(
    entries: FloatArray, slots: IntArray, is_turned: BoolArray, blocks: FloatArray
) -> None:
    """Add blocks (B, 3, 3) to their entries."""
    for i in range(len(slots)):
        entry = entries[slots[i]]
        for row in range(3):
            for col in range(3):
                if is_turned[i]:
                    entry[row, col] += blocks[i, col, row]
                else:
                    entry[row, col] += blocks[i, row, col]


@kernel
def find_pattern(starts: IntArray, rows: IntArray) -> tuple[IntArray, IntArray]:
    """Find the elimination tree and the entries below the diagonal in each column of L.

    Args:
        starts: (M + 1,) begin of each column of the upper triangle.
        rows: (nonzeros,)

    Returns:
        The parent of each column, -1 for none, (M,), and the begin of each column of L, (M + 1,).
    """
    size = len(starts) - 1
    parents = np.full(size, -1)
    flags = np.full(size, -1)
    ends = np.zeros(size + 1, dtype=np.int64)
    for col in range(size):
        flags[col] = col
        for entry in range(starts[col], starts[col + 1]):
            row = rows[entry]
            while row < col and flags[row] != col:
                if parents[row] == -1:
                    parents[row] = col
                ends[row + 1] += 1
                flags[row] = col
                row = parents[row]
    return parents, np.cumsum(ends)


@kernel
def add_product(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    """Add a^T b to ``out``, all (3, 3)."""
    for row in range(3):
        for col in range(3):
            for i in range(3):
                out[row, col] += a[i, row] * b[i, col]


@kernel
def subtract_product(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    """Subtract a b from ``out`` (3, K), a (3, 3), b (3, K)."""
    for row in range(3):
        x = a[row, 0]
        y = a[row, 1]
        z = a[row, 2]
        for col in range(out.shape[1]):
            out[row, col] -= x * b[0, col] + y * b[1, col] + z * b[2, col]


@kernel
def fill_factor(
    starts: IntArray, rows: IntArray, entries: FloatArray, parents: IntArray, lower_starts: IntArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Factorise a symmetric positive matrix of 3 x 3 blocks.

    Args:
        starts: (M + 1,) begin of each column of the upper triangle.
        rows: (nonzeros,)
        entries: (nonzeros, 3, 3)
        parents: From :func:`find_pattern`.
        lower_starts: The same.

    Returns:
        Rows and entries of L, and the inverse blocks of D, as :class:`Factor` has them.
    """
    size = len(parents)
    nonzeros = lower_starts[-1]
    lower_rows = np.empty(nonzeros, dtype=np.int64)
    lower = np.zeros((nonzeros, 3, 3))
    inverse = np.empty((size, 3, 3))
    work = np.zeros((size, 3, 3))
    path = np.empty(size, dtype=np.int64)
    flags = np.full(size, -1)
    filled = np.zeros(size, dtype=np.int64)
    column = np.empty((3, 3))
    for col in range(size):
        top = size
        flags[col] = col
        for entry in range(starts[col], starts[col + 1]):
            row = rows[entry]
            work[row] += entries[entry]
            length = 0
            while flags[row] != col:
                path[length] = row
                length += 1
                flags[row] = col
                row = parents[row]
            while length > 0:
                top -= 1
                length -= 1
                path[top] = path[length]
        pivot = work[col].copy()
        work[col] = 0.0
        for at in range(top, size):
            row = path[at]
            column[:] = work[row]
            work[row] = 0.0
            end = lower_starts[row] + filled[row]
            for entry in range(lower_starts[row], end):
                target = work[lower_rows[entry]]
                subtract_product(lower[entry], column, target)
            add_product(column, inverse[row], lower[end])
            subtract_product(lower[end], column, pivot)
            lower_rows[end] = col
            filled[row] += 1
        inverse[col] = inverted(pivot)
    return lower_rows, lower, inverse


@kernel
def ancestors(starts: IntArray, rows: IntArray, col: int) -> IntArray:
    """A column of L and all later ones that depend on it, in order: its path in the elimination tree."""
    path = np.empty(len(starts) - 1, dtype=np.int64)
    length = 1
    path[0] = col
    while starts[col] < starts[col + 1]:
        col = rows[starts[col]]
        path[length] = col
        length += 1
    return path[:length]


@kernel
def substitute(
    starts: IntArray,
    rows: IntArray,
    lower: FloatArray,
    inverse: FloatArray,
    x: FloatArray,
    down: IntArray,
    up: IntArray,
) -> None:
    """Solve L D L^T x = x in place.

    Args:
        starts: (M + 1,) begin of each column of L.
        rows: (nonzeros,)
        lower: (nonzeros, 3, 3)
        inverse: (M, 3, 3) inverses of D.
        x: (M, 3, K)
        down: Columns in which the right-hand side isn't zero and all their ancestors, in order.
        up: Those in which the solution is wanted and all their ancestors, in order.
    """
    scaled = np.empty(x.shape[1:])
    for col in down:
        for entry in range(starts[col], starts[col + 1]):
            subtract_product(lower[entry], x[col], x[rows[entry]])
    for col in up[::-1]:
        scaled[:] = 0.0
        subtract_product(inverse[col], x[col], scaled)
        x[col] = -scaled
        for entry in range(starts[col], starts[col + 1]):
            subtract_product(lower[entry].T, x[rows[entry]], x[col])
