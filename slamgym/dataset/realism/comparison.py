"""Sets of maps compared: statistics side by side, and how well learners distinguish the sets."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from slamgym.core.config import Count, Settings
from slamgym.core.intervals import Interval, median_interval
from slamgym.dataset.realism.map_sets import MapSet, MeasuredMap
from slamgym.metrics.map_look import LOOK_NAMES
from slamgym.metrics.two_sample import Distinction, MapLearner, distinguish, half_against_half

LearnerOf = Callable[[Sequence[MeasuredMap]], MapLearner]
"""A learner for the maps that it is given."""


class SetTestConfig(Settings):
    """How sets are tested."""

    folds: Count = 5
    """Parts of the buildings that are held out in turn."""
    repeats: Count = 2
    """How often the buildings are dealt to the parts again."""
    halvings: Count = 10
    """How often a set is halved for its null."""
    seed: int = 0


@dataclass(frozen=True)
class StatisticRow:
    """One statistic over all sets."""

    name: str
    label: str
    medians: dict[str, Interval]
    """By set, with a 95 % bootstrap interval over buildings."""
    distances: dict[str, float]
    """Kolmogorov-Smirnov distance of the dataset from each reference set: a threshold on this statistic alone
    distinguishes them with a balanced accuracy of (1 + distance) / 2."""

    @property
    def telling(self) -> float:
        """Mean distance over the reference sets."""
        return float(np.mean(list(self.distances.values())))


@dataclass(frozen=True)
class SetTestRow:
    """How well one learner distinguishes two sets, or the halves of one."""

    first: str
    second: str
    learner: str
    accuracy: Interval

    @property
    def is_null(self) -> bool:
        """Whether these are halves of one set."""
        return self.first == self.second


def compare_statistics(own: MapSet, references: Sequence[MapSet], seed: int = 0) -> list[StatisticRow]:
    """The statistics that a person reads, in their order."""
    from scipy.stats import ks_2samp

    rows = []
    for name, label in LOOK_NAMES.items():
        values = {s.name: np.array([row[name] for row in s.statistics]) for s in (own, *references)}
        medians = {s.name: median_interval(values[s.name], seed, s.buildings) for s in (own, *references)}
        # The distance alone is wanted; the exact p-value beside it costs more and warns on small samples.
        distances = {
            s.name: float(ks_2samp(values[own.name], values[s.name], method="asymp").statistic)
            for s in references
        }
        rows.append(StatisticRow(name, label, medians, distances))
    return rows


def distinguish_sets(
    first: MapSet, second: MapSet, learner_of: LearnerOf, config: SetTestConfig
) -> Distinction:
    """Try to distinguish two sets."""
    maps = [*first.maps, *second.maps]
    of_second = np.arange(len(maps)) >= len(first.maps)
    return distinguish(
        of_second,
        [*first.buildings, *second.buildings],
        learner_of(maps),
        config.folds,
        config.repeats,
        config.seed,
    )


def distinguish_halves(one: MapSet, learner_of: LearnerOf, config: SetTestConfig) -> Interval:
    """Try to distinguish the halves of a set."""
    return half_against_half(one.buildings, learner_of(one.maps), config.folds, config.halvings, config.seed)


def most_unlike(
    own: Sequence[MeasuredMap], others: Sequence[MeasuredMap], name: str, count: int
) -> tuple[list[int], list[int]]:
    """The maps of either side that lie furthest on its own side of a statistic.

    Returns:
        Their indices, the furthest first.
    """
    mine, theirs = (np.array([one.statistics[name] for one in maps]) for maps in (own, others))
    sign = 1.0 if np.median(mine) >= np.median(theirs) else -1.0
    order = np.argsort(-sign * mine, kind="stable"), np.argsort(sign * theirs, kind="stable")
    return order[0][:count].tolist(), order[1][:count].tolist()
