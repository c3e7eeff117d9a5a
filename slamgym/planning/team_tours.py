"""Tours for several travellers: places shared out so that the last one is done soonest.

Open tours with the longest one as their cost (min-max multiple travelling salesmen; Franca et al., "The m-traveling
salesman problem with minmax objective", Transportation Science 29(3), 1995). Up to
:data:`~slamgym.planning.open_tour.EXACT_PLACES` places are shared out exactly: one dynamic programme gives the shortest
tour through each set of them, another the best partition into such sets. Beyond, places are inserted where the tour
that gets them stays shortest, the far ones first; then places of the longest tour are given away, or exchanged for
those of others, as long as the longest gets shorter.
"""

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import FloatArray, IntArray
from slamgym.planning.open_tour import EXACT_PLACES, finite_lengths, held_karp, open_tour

SUM_WEIGHT = 0.01
"""Of partitions whose longest tours are alike, that with the shorter tours in all is better."""
LEAST_GAIN = 1e-3
"""An exchange that makes the longest tour shorter by less is none [m]: rounding could undo it for ever."""


def share_tours(starts: FloatArray, between: FloatArray, loads: FloatArray) -> list[list[int]]:
    """Share places out.

    Args:
        starts: Path lengths from each traveller to each place, shape (R, N) [m]; inf where no path leads.
        between: Path lengths between the places, shape (N, N) [m].
        loads: What each place takes beside the way, shape (N,) [m].

    Returns:
        The places of each traveller in the order of its visits; together each place once.
    """
    team = _Team(finite_lengths(starts), finite_lengths(np.minimum(between, between.T)), loads)
    if len(loads) <= EXACT_PLACES:
        team.share_exactly()
        return team.tours
    farthest_first = np.argsort(-team.starts.min(axis=0), kind="stable")
    for place in farthest_first.tolist():
        grown = [length + team.detour(k, place) for k, length in enumerate(team.lengths)]
        team.put(int(np.argmin(grown)), place)
    for robot in range(len(starts)):
        team.order(robot)
    while team.exchange():
        pass
    return team.tours


class _Team:
    """Travellers and their tours so far."""

    def __init__(self, starts: FloatArray, between: FloatArray, loads: FloatArray) -> None:
        self.starts = starts
        self._between = between
        self._loads = loads
        self.tours: list[list[int]] = [[] for _ in starts]
        self.lengths = np.zeros(len(starts))

    def share_exactly(self) -> None:
        """Share out few places."""
        sets = np.arange(1 << len(self._loads))
        members = (sets[:, None] >> np.arange(len(self._loads))) & 1
        lengths = [
            held_karp(np.ascontiguousarray(start), self._between)[0].min(axis=1, initial=np.inf)
            for start in self.starts
        ]
        costs = np.array(lengths) + (members * self._loads).sum(axis=1)
        costs[:, 0] = 0.0
        for robot, own in enumerate(best_partition(costs).tolist()):
            self.tours[robot] = np.flatnonzero(members[own]).tolist()
            self._measure(robot)
            self.order(robot)

    def detour(self, robot: int, place: int) -> float:
        """By how much one more place makes a tour longer [m]."""
        tour = np.array(self.tours[robot], dtype=np.int64)
        detour, _ = insertion(self.starts[robot], self._between, tour, -1, place)
        return float(detour + self._loads[place])

    def put(self, robot: int, place: int) -> None:
        """Put a place into a tour where that is the least detour."""
        tour = np.array(self.tours[robot], dtype=np.int64)
        _, at = insertion(self.starts[robot], self._between, tour, -1, place)
        self.tours[robot].insert(at, place)
        self._measure(robot)

    def _measure(self, robot: int) -> None:
        tour = self.tours[robot]
        first = self.starts[robot, tour[0]] if tour else 0.0
        legs = self._between[tour[:-1], tour[1:]].sum()
        self.lengths[robot] = first + legs + self._loads[tour].sum()

    def order(self, robot: int) -> None:
        """Bring a tour into the best order, or a better one where it has many places."""
        tour = self.tours[robot]
        lengths = np.zeros((len(tour) + 1, len(tour) + 1))
        lengths[0, 1:] = lengths[1:, 0] = self.starts[robot, tour]
        lengths[1:, 1:] = self._between[np.ix_(tour, tour)]
        before = self.lengths[robot]
        self.tours[robot] = [tour[index - 1] for index in open_tour(lengths).tolist()]
        self._measure(robot)
        if self.lengths[robot] > before:
            self.tours[robot] = tour
            self._measure(robot)

    def exchange(self) -> bool:
        """Do the best exchange that makes the longest tour shorter; False if there is none."""
        longest = int(np.argmax(self.lengths))
        counts = np.array([len(tour) for tour in self.tours])
        tours = np.zeros((len(counts), counts.max()), dtype=np.int64)
        for row, tour in zip(tours, self.tours, strict=True):
            row[: len(tour)] = tour
        lengths = self.lengths
        robot, given, taken = best_exchange(
            self.starts, self._between, self._loads, tours, counts, lengths, longest
        )
        if robot < 0:
            return False
        before = lengths[longest]
        kept = [list(tour) for tour in self.tours]
        place = self.tours[longest].pop(given)
        other = self.tours[robot].pop(taken) if taken >= 0 else -1
        self.put(robot, place)
        if other >= 0:
            self.put(longest, other)
        for changed in (longest, robot):
            self._measure(changed)
            self.order(changed)
        if self.lengths[[longest, robot]].max() < before:
            return True
        self.tours = kept
        return False


@kernel
def best_partition(costs: FloatArray) -> IntArray:
    """The set of places that each traveller gets, so that the dearest set is cheapest.

    Args:
        costs: Of each set for each traveller, shape (R, 2^N): place k is in those whose number has bit k.

    Returns:
        Numbers of sets, shape (R,).
    """
    robots, sets = costs.shape
    worst = costs.copy()  # of the travellers up to one, if they share a set out
    total = costs.copy()
    chosen = np.zeros((robots, sets), np.int64)  # what the last of them gets
    chosen[0] = np.arange(sets)
    for robot in range(1, robots):
        for shared in range(sets):
            best = np.inf
            own = shared
            while own >= 0:
                left = shared ^ own
                longest = max(worst[robot - 1, left], costs[robot, own])
                both = total[robot - 1, left] + costs[robot, own]
                if longest + SUM_WEIGHT * both < best:
                    best = longest + SUM_WEIGHT * both
                    worst[robot, shared] = longest
                    total[robot, shared] = both
                    chosen[robot, shared] = own
                own = (own - 1) & shared if own > 0 else -1
    found = np.zeros(robots, np.int64)
    left = sets - 1
    for robot in range(robots - 1, -1, -1):
        found[robot] = chosen[robot, left]
        left ^= found[robot]
    return found


@kernel
def _leg(starts: FloatArray, between: FloatArray, here: int, there: int) -> float:
    """Length of the way between two places, from the traveller's own where the first is -1."""
    return starts[there] if here < 0 else between[here, there]


@kernel
def insertion(
    starts: FloatArray, between: FloatArray, tour: IntArray, skip: int, place: int
) -> tuple[float, int]:
    """The least detour for one more place, and where in the tour it goes.

    Args:
        starts: Path lengths from the traveller to each place, shape (N,).
        between: Between the places, shape (N, N).
        tour: Places.
        skip: The place at this index counts as left out; -1 for none.
        place: The one more.
    """
    best = np.inf
    at = 0
    number = 0
    before = -1
    for index in range(len(tour) + 1):
        if index == skip:
            continue
        here = tour[index] if index < len(tour) else -1
        detour = _leg(starts, between, before, place)
        if here >= 0:
            detour += between[place, here] - _leg(starts, between, before, here)
        if detour < best:
            best = detour
            at = number
        before = here
        number += 1
    return best, at


@kernel
def _saving(starts: FloatArray, between: FloatArray, tour: IntArray, index: int) -> float:
    """By how much a tour gets shorter without one of its places."""
    before = tour[index - 1] if index > 0 else -1
    saving = _leg(starts, between, before, tour[index])
    if index + 1 < len(tour):
        after = tour[index + 1]
        saving += between[tour[index], after] - _leg(starts, between, before, after)
    return saving


@kernel
def best_exchange(
    starts: FloatArray,
    between: FloatArray,
    loads: FloatArray,
    tours: IntArray,
    counts: IntArray,
    lengths: FloatArray,
    longest: int,
) -> tuple[int, int, int]:
    """The exchange after which the longer of two tours is shortest, one of them the longest of all.

    Args:
        starts: As :func:`share_tours` takes them.
        between: The same.
        loads: The same.
        tours: Of each traveller, shape (R, most).
        counts: Of their places, shape (R,).
        lengths: Of the tours, shape (R,) [m].
        longest: The traveller who gives.

    Returns:
        Who gets a place, its index in the longest tour, and the index of the place that is given for it, -1 for none;
        (-1, -1, -1) if no exchange helps.
    """
    best = lengths[longest] - LEAST_GAIN
    found = (-1, -1, -1)
    own = tours[longest, : counts[longest]]
    for given in range(len(own)):
        place = own[given]
        left = lengths[longest] - loads[place] - _saving(starts[longest], between, own, given)
        for robot in range(len(tours)):
            if robot == longest:
                continue
            tour = tours[robot, : counts[robot]]
            detour, _ = insertion(starts[robot], between, tour, -1, place)
            worst = max(left, lengths[robot] + detour + loads[place])
            if worst < best:
                best = worst
                found = (robot, given, -1)
            for taken in range(len(tour)):
                back = tour[taken]
                rest = lengths[robot] - loads[back] - _saving(starts[robot], between, tour, taken)
                detour, _ = insertion(starts[robot], between, tour, taken, place)
                theirs = rest + detour + loads[place]
                if theirs < best:
                    detour, _ = insertion(starts[longest], between, own, given, back)
                    worst = max(theirs, left + detour + loads[back])
                    if worst < best:
                        best = worst
                        found = (robot, given, taken)
    return found
