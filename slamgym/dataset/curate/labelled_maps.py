"""Maps with features and the truth about them, to train and to judge the classifier of completeness."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from slamgym.core.progress import show_progress
from slamgym.core.types import BoolArray, FloatArray
from slamgym.dataset.curate.completeness import FEATURES, completeness_features
from slamgym.dataset.curate.criteria import STUCK_PATH, Criteria, StuckFilter, has_clutter
from slamgym.dataset.curate.snapshots import MINUTES, take_snapshots
from slamgym.dataset.format import PairRecord


@dataclass(frozen=True)
class LabelledMaps:
    """Snapshots of explorations; arrays of the same length N."""

    features: FloatArray  # (N, 15)
    complete: BoolArray  # by the truth
    coverage: FloatArray  # true
    minutes: FloatArray  # robot time since the start [min]
    is_last: BoolArray  # whether the exploration ended there
    is_stuck: BoolArray  # by the truth: hardly driven, and incomplete
    looks_stuck: BoolArray  # by the filter, from the map alone
    plan_ids: tuple[str, ...]
    sources: tuple[str, ...]  # what each comes from, e.g. the dataset's name

    def __len__(self) -> int:
        return len(self.complete)

    def where(self, chosen: BoolArray) -> "LabelledMaps":
        """Some of the maps."""
        kept = np.flatnonzero(chosen)
        return LabelledMaps(
            features=self.features[kept],
            complete=self.complete[kept],
            coverage=self.coverage[kept],
            minutes=self.minutes[kept],
            is_last=self.is_last[kept],
            is_stuck=self.is_stuck[kept],
            looks_stuck=self.looks_stuck[kept],
            plan_ids=tuple(self.plan_ids[i] for i in kept),
            sources=tuple(self.sources[i] for i in kept),
        )

    @property
    def learnable(self) -> BoolArray:
        """Which maps the classifier learns from: those that the stuck filter lets through."""
        return ~self.looks_stuck


def label_maps(
    pairs: Sequence[tuple[Path, PairRecord]],
    criteria: Criteria,
    stuck: StuckFilter,
    minutes: Sequence[float] = MINUTES,
) -> LabelledMaps:
    """Draw the maps of explorations at some moments, measure them, and label them by the truth.

    Args:
        pairs: Datasets and their records of pairs.
        criteria: When a map is complete.
        stuck: Tells which maps look like those of a stuck robot.
        minutes: Robot times besides the end [min].

    Raises:
        InputFileError: If a file of an exploration is missing or malformed.
    """
    rows: list[tuple[FloatArray, bool, float, float, bool, bool, bool, str, str]] = []
    with show_progress("explorations", 0, len(pairs)) as advance:
        for root, record in pairs:
            clutter = has_clutter(record)
            for shot in take_snapshots(root, record, minutes):
                features = completeness_features(shot.cells, shot.resolution)
                faults = criteria.faults(shot.coverage, shot.map_error, shot.ate, has_clutter=clutter)
                rows.append(
                    (
                        features,
                        not faults,
                        shot.coverage,
                        shot.time / 60.0,
                        shot.is_last,
                        shot.path_length < STUCK_PATH and shot.coverage < criteria.min_coverage,
                        bool(stuck.why_stuck(features, shot.resolution)),
                        shot.plan_id,
                        root.name,
                    )
                )
            advance()
    return _from_rows(rows)


def _from_rows(
    rows: Iterable[tuple[FloatArray, bool, float, float, bool, bool, bool, str, str]],
) -> LabelledMaps:
    columns = list(zip(*rows, strict=True)) or [()] * 9
    features, complete, coverage, minutes, is_last, is_stuck, looks_stuck, plan_ids, sources = columns
    return LabelledMaps(
        features=np.array(features, dtype=np.float64).reshape(-1, len(FEATURES)),
        complete=np.array(complete, dtype=np.bool_),
        coverage=np.array(coverage, dtype=np.float64),
        minutes=np.array(minutes, dtype=np.float64),
        is_last=np.array(is_last, dtype=np.bool_),
        is_stuck=np.array(is_stuck, dtype=np.bool_),
        looks_stuck=np.array(looks_stuck, dtype=np.bool_),
        plan_ids=tuple(plan_ids),
        sources=tuple(sources),
    )
