"""The tests between sets of maps, on samples whose answer is known."""

import numpy as np
import pytest

from slamgym.core.errors import ConfigError
from slamgym.metrics.two_sample import distinguish, half_against_half, ks_distance, tree_learner


def sample(shift: float, count: int, seed: int):
    rng = np.random.default_rng(seed)
    return [{"a": rng.normal(shift), "b": rng.normal()} for _ in range(count)]


def test_distinguishing_is_balanced_and_held_out_by_building():
    pytest.importorskip("sklearn")
    rows = [*sample(0.0, 24, 0), *sample(6.0, 8, 1)]
    of_second = np.arange(32) >= 24
    buildings = [str(i // 2) for i in range(32)]
    seen = []

    def learner(train, labels, seed):
        assert not {b for b, t in zip(buildings, train, strict=True) if t} & {
            b for b, t in zip(buildings, train, strict=True) if not t
        }
        seen.append(len(set(labels[train])))
        return tree_learner(rows, 20)(train, labels, seed)

    found = distinguish(of_second, buildings, learner, folds=5)
    assert seen == [2, 2, 2, 2]  # as many folds as the smaller set has buildings
    assert found.value > 0.95
    always_first = distinguish(
        of_second, buildings, lambda train, *_: np.zeros((~train).sum()), folds=4
    )
    assert always_first.value == 0.5
    assert half_against_half(buildings, tree_learner(sample(0.0, 32, 2), 20), 4, 6).low < 0.5


def test_each_repeat_and_each_seed_deals_the_buildings_anew():
    of_second, buildings = np.arange(24) >= 12, [str(i) for i in range(24)]
    deals = []
    for seed in (0, 0, 1):
        held = []

        def learner(train, labels, seed, held=held):
            held.append(tuple(np.flatnonzero(~train)))
            return np.zeros((~train).sum())

        distinguish(of_second, buildings, learner, folds=3, repeats=2, seed=seed)
        assert sorted(i for fold in held[:3] for i in fold) == list(range(24))
        deals.append([set(held[:3]), set(held[3:])])
    assert deals[0] == deals[1]
    assert deals[0][0] != deals[0][1]
    assert deals[0][0] not in deals[2]


def test_distinguishing_needs_two_buildings_of_each_kind():
    with pytest.raises(ConfigError, match="two buildings"):
        distinguish(np.array([False, False, True]), ["a", "b", "c"], tree_learner([]), 5)


def test_the_distance_of_a_statistic_tells_how_far_a_threshold_goes():
    assert ks_distance([0.0, 1.0], [2.0, 3.0]) == 1.0
    assert ks_distance([0.0, 1.0, 2.0, 3.0], [2.0, 3.0, 4.0, 5.0]) == pytest.approx(0.5)
