"""Places shared out among several travellers."""

import itertools

import numpy as np
import pytest

from slamgym.planning.open_tour import open_tour
from slamgym.planning.team_tours import share_tours


def lengths_of(tours, starts, between, loads):
    """Length of each tour, place by place."""
    found = []
    for start, tour in zip(starts, tours, strict=True):
        legs = [between[a, b] for a, b in itertools.pairwise(tour)]
        found.append(sum(legs) + loads[tour].sum() + (start[tour[0]] if tour else 0.0))
    return found


def drawn(seed, robots, places):
    rng = np.random.default_rng(seed)
    points = rng.uniform(0.0, 10.0, (places, 2))
    begins = rng.uniform(0.0, 10.0, (robots, 2))
    between = np.hypot(*(points[:, None] - points).transpose(2, 0, 1))
    starts = np.hypot(*(begins[:, None] - points).transpose(2, 0, 1))
    return starts, between, rng.uniform(0.0, 3.0, places)


@pytest.mark.parametrize("seed", range(6))
def test_the_longest_tour_of_few_places_is_the_shortest_possible(seed):
    starts, between, loads = drawn(seed, 2, 6)
    tours = share_tours(starts, between, loads)
    assert sorted(place for tour in tours for place in tour) == list(range(6))
    best = np.inf
    for order in itertools.permutations(range(6)):
        for cut in range(7):
            split = [list(order[:cut]), list(order[cut:])]
            best = min(best, max(lengths_of(split, starts, between, loads)))
    # Where sums decide, the longest may be longer by so much.
    assert max(lengths_of(tours, starts, between, loads)) <= 1.02 * best


@pytest.mark.parametrize("robots", [2, 3, 4])
def test_many_places_are_shared_out_evenly(robots):
    starts, between, loads = drawn(robots, robots, 24)
    tours = share_tours(starts, between, loads)
    assert sorted(place for tour in tours for place in tour) == list(range(24))
    (alone,) = share_tours(starts[:1], between, loads)
    whole = lengths_of([alone], starts[:1], between, loads)[0]
    # An even share, and the ways to it: in these draws at most a fifth more.
    assert max(lengths_of(tours, starts, between, loads)) <= 1.2 * whole / robots


def test_one_traveller_drives_the_tour_that_it_would_drive_alone():
    starts, between, loads = drawn(1, 1, 8)
    lengths = np.block([[np.zeros((1, 1)), starts], [starts.T, between]])
    alone = [index - 1 for index in open_tour(lengths).tolist()]
    (tour,) = share_tours(starts, between, loads)
    assert lengths_of([tour], starts, between, loads) == pytest.approx(
        lengths_of([alone], starts, between, loads)
    )


def test_a_traveller_gets_no_place_that_no_path_leads_it_to():
    starts, between, loads = drawn(2, 2, 5)
    starts[1] = np.inf
    assert share_tours(starts, between, loads)[1] == []


def test_what_takes_long_counts_like_a_long_way():
    starts = np.array([[1.0, 1.0, 1.0], [1.1, 1.1, 1.1]])
    between = np.ones((3, 3)) - np.eye(3)
    tours = share_tours(starts, between, np.array([9.0, 0.0, 0.0]))
    assert sorted(map(len, tours)) == [1, 2]
    assert [0] in tours


def test_no_places_make_empty_tours():
    assert share_tours(np.zeros((3, 0)), np.zeros((0, 0)), np.zeros(0)) == [[], [], []]
