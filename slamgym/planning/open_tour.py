"""Open tours: from a start through all places, ending anywhere.

The shortest one is exact up to :data:`EXACT_PLACES` places, by dynamic programming over subsets (Held and
Karp, "A dynamic programming approach to sequencing problems", J. SIAM 10(1), 1962); beyond, a
nearest-neighbour tour is improved by 2-opt and Or-opt moves (Croes 1958; Or 1976) until none helps.
"""

import numpy as np

from slamgym.core.jit import assign, kernel
from slamgym.core.types import FloatArray, IntArray

EXACT_PLACES = 9
"""Most places that are ordered exactly: 2^9 * 9 states take some tens of microseconds."""

_EXACT_FIRSTS = 11
"""Most places for which the shortest tour from each of them is exact: 0.5 ms, and no order has to be kept."""

_FAR = 1e5
"""Stands for "no path" [m]: beyond every building, yet small enough that sums of it keep micrometres."""

_GAIN = 1e-6
"""A move that shortens a tour by less is none [m]: rounding could undo it for ever."""


def open_tour(lengths: FloatArray) -> IntArray:
    """Order of the places in a short open tour from the start.

    Args:
        lengths: Path lengths between start and places, the start first, shape (N + 1, N + 1) [m], symmetric;
            inf where no path leads.

    Returns:
        Indices 1 to N in the order of the visits, shape (N,). Places that can't be reached come last.
    """
    if len(lengths) - 1 <= EXACT_PLACES:
        return exact_tour(finite_lengths(lengths))
    # Moves are measured as if a stretch were as long backwards; else they might go round in circles.
    matrix = finite_lengths(np.minimum(lengths, lengths.T))
    return improve_tour(matrix, nearest_neighbour_tour(matrix))


def lengths_by_first(lengths: FloatArray) -> FloatArray:
    """Length of a short open tour through all places for each place that it may begin with.

    Args:
        lengths: As :func:`open_tour` takes them.

    Returns:
        Shape (N,) [m]: the shortest for up to 11 places, beyond as near to it as 2-opt and Or-opt get.
    """
    matrix = finite_lengths(lengths)
    between = np.ascontiguousarray(np.minimum(matrix, matrix.T)[1:, 1:])
    is_exact = len(between) <= _EXACT_FIRSTS
    onwards = exact_paths(between) if is_exact else short_paths(between)
    return matrix[0, 1:] + onwards


def finite_lengths(lengths: FloatArray) -> FloatArray:
    """Path lengths with a number for those that are infinite."""
    return np.where(np.isfinite(lengths), lengths, _FAR).astype(np.float64)


@kernel
def exact_paths(lengths: FloatArray) -> FloatArray:
    """Length of the shortest path through all places from each of them, by the same programme, shape (N,)."""
    n = len(lengths)
    best, _ = held_karp(np.zeros(n), lengths)
    return best[(1 << n) - 1].copy()  # a path that ends at a place is as long as the same backwards


@kernel
def short_paths(lengths: FloatArray) -> FloatArray:
    """Length of a short path through all places from each of them, improved as tours are, shape (N,)."""
    n = len(lengths)
    found = np.zeros(n)
    order = np.arange(n)
    for first in range(n):
        order[0], order[first] = order[first], order[0]
        own = lengths[order][:, order]
        here = 0
        for place in improve_tour(own, nearest_neighbour_tour(own)):
            found[first] += own[here, place]
            here = place
        order[0], order[first] = order[first], order[0]
    return found


@kernel
def held_karp(starts: FloatArray, between: FloatArray) -> tuple[FloatArray, IntArray]:
    """Shortest way to have visited each set of places and stand at one of them, and the place before it.

    Args:
        starts: Length of the leg that reaches each place first, shape (N,).
        between: Lengths of the legs, shape (N, N).

    Returns:
        Both of shape (2^N, N).
    """
    n = len(starts)
    best = np.full((1 << n, n), np.inf)
    before = np.full((1 << n, n), -1, np.int64)
    for i in range(n):
        best[1 << i, i] = starts[i]
    for visited in range(1, 1 << n):
        for last in range(n):
            so_far = best[visited, last]
            if not so_far < np.inf:
                continue
            for following in range(n):
                if visited >> following & 1:
                    continue
                both = visited | (1 << following)
                length = so_far + between[last, following]
                if length < best[both, following]:
                    best[both, following] = length
                    before[both, following] = last
    return best, before


@kernel
def exact_tour(lengths: FloatArray) -> IntArray:
    """Held and Karp's dynamic programme for an open tour from place 0."""
    n = len(lengths) - 1
    order = np.empty(n, np.int64)
    if n == 0:
        return order
    starts = np.ascontiguousarray(lengths[0, 1:])
    between = np.ascontiguousarray(lengths[1:, 1:])
    best, before = held_karp(starts, between)
    visited = (1 << n) - 1
    last = int(np.argmin(best[visited]))
    for position in range(n - 1, -1, -1):
        order[position] = last + 1
        previous = before[visited, last]
        visited ^= 1 << last
        last = previous
    return order


@kernel
def nearest_neighbour_tour(lengths: FloatArray) -> IntArray:
    """Always on to the nearest place that is left, from place 0."""
    n = len(lengths) - 1
    left = np.ones(n + 1, np.bool_)
    left[0] = False
    order = np.empty(n, np.int64)
    here = 0
    for position in range(n):
        nearest = -1
        for place in range(1, n + 1):
            if left[place] and (nearest < 0 or lengths[here, place] < lengths[here, nearest]):
                nearest = place
        order[position] = here = nearest
        left[nearest] = False
    return order


@kernel
def improve_tour(lengths: FloatArray, order: IntArray) -> IntArray:
    """Reverse stretches (2-opt) and move stretches of up to 3 places (Or-opt) while the tour gets shorter.

    The lengths must be symmetric, or it may never end.
    """
    tour = np.zeros(len(order) + 1, np.int64)
    assign(order, tour[1:])
    improved = True
    while improved:
        improved = two_opt(lengths, tour)
        improved = _or_opt(lengths, tour) or improved
    return tour[1:].copy()


@kernel
def two_opt(lengths: FloatArray, tour: IntArray) -> bool:
    """Do all reversals that help; the last place has no successor. Returns whether there was any."""
    n = len(tour)
    improved = False
    for i in range(1, n - 1):
        for j in range(i + 1, n):
            change = lengths[tour[i - 1], tour[j]] - lengths[tour[i - 1], tour[i]]
            if j + 1 < n:
                change += lengths[tour[i], tour[j + 1]] - lengths[tour[j], tour[j + 1]]
            if change < -_GAIN:
                for k in range((j - i + 1) // 2):
                    tour[i + k], tour[j - k] = tour[j - k], tour[i + k]
                improved = True
    return improved


@kernel
def _or_opt(lengths: FloatArray, tour: IntArray) -> bool:
    """Do the first move of a stretch that helps. Returns whether there was one."""
    n = len(tour)
    for size in range(1, 4):
        for first in range(1, n - size + 1):
            last = first + size - 1
            taken = lengths[tour[first - 1], tour[first]]
            if last + 1 < n:
                taken += (
                    lengths[tour[last], tour[last + 1]] - lengths[tour[first - 1], tour[last + 1]]
                )
            for after in range(n):
                # The stretch goes between the places at `after` and `after + 1`, in its order.
                if first - 1 <= after <= last:
                    continue
                added = lengths[tour[after], tour[first]]
                if after + 1 < n:
                    added += (
                        lengths[tour[last], tour[after + 1]] - lengths[tour[after], tour[after + 1]]
                    )
                if added - taken < -_GAIN:
                    before = tour.copy()
                    begin = min(first, after + 1)
                    end = max(last, after) + 1
                    shift = first - begin if after < first else size
                    for k in range(begin, end):
                        tour[k] = before[begin + (k - begin + shift) % (end - begin)]
                    return True
    return False
