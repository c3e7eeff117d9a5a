"""Comparison of a dataset's maps with those of robots: sets of maps, statistics side by side, and two-sample tests."""

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.intervals import Interval, median_interval
from slamgym.core.progress import counted
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, ByteArray, OccupancyGrid
from slamgym.dataset.curate.map_items import open_items
from slamgym.metrics.map_statistics import (
    COARSEST_CELL,
    LOOK_CELL,
    LOOK_NAMES,
    at_look_cell,
    cut_to_floor,
    look_statistics,
)
from slamgym.metrics.two_sample import (
    MapLearner,
    distinguish,
    half_against_half,
    ks_distance,
    tree_learner,
)

TREES = "trees on statistics"
"""Name of the learner that :func:`learn_by_trees` makes."""
FOLDS = 5
"""Parts of the buildings that are held out in turn by a test."""
MIN_MAPS = 8
"""Maps that a set needs: halves of fewer say nothing."""
MIN_BUILDINGS = 4
"""Buildings that a set needs: halves need two each."""
_LEAST_FREE = 4.0
"""Free space that a map needs to be compared [m2]."""
_MOST_OCCUPIED = 0.4
"""Largest share of occupied cells among the known ones of a map to compare; SLAM maps have a tenth."""


@dataclass(frozen=True)
class MeasuredMap:
    """A map of a set."""

    name: str
    building: str
    """Maps of one building are never on both sides of a test."""
    cells: ByteArray
    """At the common cell size, whole, (H, W)."""
    statistics: dict[str, float]
    """Statistics of the part around the floor."""

    @property
    def floor(self) -> ByteArray:
        """The part around the largest free space."""
        return cut_to_floor(self.cells)


def measure_map(name: str, building: str, cells: ByteArray, resolution: float) -> MeasuredMap:
    """Bring a map to the common cell size and measure it.

    Args:
        name: Of the map.
        building: What it shows.
        cells: 0, 205, 254, (H, W).
        resolution: [m/cell].
    """
    cells = at_look_cell(cells, resolution)
    floor = cut_to_floor(cells)
    # A picture without floor, as a bad generator draws it, is measured whole.
    return MeasuredMap(name, building, cells, look_statistics(floor if floor.size else cells))


@dataclass(frozen=True)
class MapSet:
    """The maps of a dataset, of a folder or of a generator."""

    name: str
    maps: list[MeasuredMap]
    skipped: dict[str, int] = field(default_factory=dict)
    """Reasons why files were left out, and how many each."""

    @property
    def buildings(self) -> list[str]:
        """Building of each map."""
        return [one.building for one in self.maps]

    @property
    def summary(self) -> str:
        """Numbers of maps and buildings, and what was left out."""
        left_out = "".join(
            f"; left out: {count} {reason}" for reason, count in self.skipped.items()
        )
        buildings = counted(len(set(self.buildings)), "building")
        return f"{counted(len(self.maps), 'map')} of {buildings}{left_out}"


def read_map_sets(roots: Sequence[Path], building: str | None = None) -> list[MapSet]:
    """Read every map of some folders.

    Args:
        roots: Datasets, or folders (with subfolders) of ROS maps.
        building: A pattern that finds the building in the name of a map from elsewhere; without it, or where
            it finds nothing, each map is a separate building.

    Raises:
        InputFileError: If a folder holds too few maps.
        ConfigError: If the pattern is malformed, or a folder is named twice.
    """
    try:
        pattern = re.compile(building) if building else None
    except re.error as error:
        raise ConfigError(f"--building {building!r} is no regular expression ({error})") from error
    if len({root.resolve() for root in roots}) < len(roots):
        raise ConfigError(
            "a folder is named twice: its maps can't be told from themselves; name each once"
        )
    names = _names(roots)
    return [_read(root, name, pattern) for root, name in zip(roots, names, strict=True)]


def _names(roots: Sequence[Path]) -> list[str]:
    """The folders' names; with their parents' where two are alike."""
    short = [root.resolve().name for root in roots]
    return [
        name if short.count(name) == 1 else "/".join(root.resolve().parts[-2:])
        for root, name in zip(roots, short, strict=True)
    ]


def _read(root: Path, name: str, building: re.Pattern[str] | None) -> MapSet:
    skipped: Counter[str] = Counter()
    maps = []
    for item in open_items(root):
        try:
            grid = item.load()
        except InputFileError:
            skipped["can't be read as a map"] += 1
            continue
        fault = _fault(grid)
        if fault:
            skipped[fault] += 1
            continue
        found = building.search(item.name) if building and item.record is None else None
        shown = found[0] if found else item.plan_id
        maps.append(measure_map(item.name, shown, grid.cells, grid.frame.resolution))
    found_set = MapSet(name, maps, dict(skipped))
    require_enough(root, found_set.buildings, found_set.skipped)
    return found_set


def _fault(grid: OccupancyGrid) -> str:
    """Why a file is no map that can be compared; empty if it is one."""
    resolution = grid.frame.resolution
    if resolution > COARSEST_CELL:
        return f"cells larger than {COARSEST_CELL:g} m"
    floor = cut_to_floor(grid.cells)
    if np.count_nonzero(floor == FREE) * resolution**2 < _LEAST_FREE:
        return f"less than {_LEAST_FREE:g} m2 of free space"
    occupied = np.count_nonzero(floor == OCCUPIED)
    if occupied == 0:
        return "no walls"
    if occupied > _MOST_OCCUPIED * np.count_nonzero(floor != UNKNOWN):
        return "more walls than a map has"
    return ""


def require_enough(
    source: Path, buildings: Sequence[str], skipped: Mapping[str, int] | None = None
) -> None:
    """Refuse sets that are too small for a test.

    Args:
        source: Where the maps are from.
        buildings: The building of each.
        skipped: Reasons why others were left out, and how many each.

    Raises:
        InputFileError: If there are too few maps or buildings.
    """
    reasons = ", ".join(f"{count} {reason}" for reason, count in (skipped or {}).items())
    left_out = f"; left out: {reasons}" if reasons else ""
    if len(buildings) < MIN_MAPS:
        raise InputFileError(
            source,
            f"holds {len(buildings)} maps that can be compared at cells of {LOOK_CELL:g} m; add some: "
            f"a test needs at least {MIN_MAPS}{left_out}",
        )
    shown = len(set(buildings))
    if shown < MIN_BUILDINGS:
        raise InputFileError(
            source,
            f"shows {shown} buildings; add maps of others: a test needs at least {MIN_BUILDINGS}",
        )


@dataclass(frozen=True)
class StatisticRow:
    """One statistic over all sets."""

    name: str
    label: str
    medians: dict[str, Interval]
    """By set, with a 95 % bootstrap interval over buildings."""
    distances: dict[str, float]
    """Kolmogorov-Smirnov distance of the dataset from each reference set."""

    @property
    def telling(self) -> float:
        """Mean distance over the reference sets."""
        return float(np.mean(list(self.distances.values())))


@dataclass(frozen=True)
class SetTestRow:
    """Result of one learner in distinguishing two sets, or the halves of one."""

    first: str
    second: str
    learner: str
    accuracy: Interval

    @property
    def is_null(self) -> bool:
        """True if these are halves of one set."""
        return self.first == self.second


@dataclass
class RealismReport:
    """Result of a comparison."""

    own: MapSet
    references: list[MapSet]
    seed: int
    statistics: list[StatisticRow]
    tests: list[SetTestRow] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    """Sentences about tests that could not be made."""

    @property
    def sets(self) -> list[MapSet]:
        """The dataset, then the references."""
        return [self.own, *self.references]

    @property
    def ranked(self) -> list[StatisticRow]:
        """The statistics, the most telling first."""
        return sorted(self.statistics, key=lambda row: -row.telling)

    def test(
        self,
        name: str,
        make_learner: Callable[[Sequence[MeasuredMap]], MapLearner],
        first: MapSet,
        second: MapSet,
        repeats: int,
    ) -> None:
        """Try to distinguish two sets, or the halves of one.

        Args:
            name: Of the learner.
            make_learner: Given the maps of the first set, then those of the second, or those of the one.
            first: A set.
            second: Another one, or the same.
            repeats: How often the buildings are dealt to the parts again, or to the halves.
        """
        is_null = first is second
        maps = first.maps if is_null else [*first.maps, *second.maps]
        buildings = [one.building for one in maps]
        learner = make_learner(maps)
        if is_null:
            accuracy = half_against_half(buildings, learner, FOLDS, repeats, self.seed)
        else:
            of_second = np.arange(len(maps)) >= len(first.maps)
            accuracy = distinguish(of_second, buildings, learner, FOLDS, repeats, self.seed)
        self.tests.append(SetTestRow(first.name, second.name, name, accuracy))

    def test_lines(self) -> dict[tuple[str, str], dict[str, Interval]]:
        """Tests by their sets, then by learner: those of the dataset first, then nulls, then between references."""
        lines: dict[tuple[str, str], dict[str, Interval]] = {}
        for test in sorted(
            self.tests, key=lambda t: (t.is_null or t.first != self.own.name, not t.is_null)
        ):
            lines.setdefault((test.first, test.second), {})[test.learner] = test.accuracy
        return lines


def compare_statistics(
    own: MapSet, references: Sequence[MapSet], seed: int = 0
) -> list[StatisticRow]:
    """The statistics that a person reads, in their order."""
    rows = []
    for name, label in LOOK_NAMES.items():
        values = {}
        medians = {}
        for one in (own, *references):
            values[one.name] = np.array([each.statistics[name] for each in one.maps])
            medians[one.name] = median_interval(values[one.name], seed, one.buildings)
        distances = {
            reference.name: ks_distance(values[own.name], values[reference.name])
            for reference in references
        }
        rows.append(StatisticRow(name, label, medians, distances))
    return rows


def learn_by_trees(maps: Sequence[MeasuredMap]) -> MapLearner:
    """Make the learner that goes by the maps' statistics."""
    return tree_learner([one.statistics for one in maps])
