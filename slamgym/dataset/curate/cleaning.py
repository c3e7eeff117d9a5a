"""The main path of ``slamgym dataset clean``: a verdict about every map, and nothing deleted."""

import dataclasses
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from slamgym import __version__
from slamgym.core.config import Counted, Settings, Share
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import sha256_of
from slamgym.core.parallel.engine import run_tasks
from slamgym.core.progress import show_progress
from slamgym.core.types import ByteArray, FloatArray, OccupancyGrid
from slamgym.dataset.curate.completeness import completeness_features
from slamgym.dataset.curate.completeness_model import PRETRAINED_MODEL, CompletenessModel
from slamgym.dataset.curate.completeness_trees import unseen_probabilities
from slamgym.dataset.curate.map_items import MapItem
from slamgym.dataset.curate.paper_features import paper_features
from slamgym.dataset.curate.review import Decision
from slamgym.dataset.curate.verdicts import Verdict, write_verdicts
from slamgym.dataset.faults import Criteria, MapFault, record_faults

_BATCH = 32
"""Maps that a worker looks at before it reports."""

_FeaturesOf = Callable[[ByteArray, float], FloatArray]
"""From cells and resolution [m/px] to the numbers that a classifier takes."""
_Seen = FloatArray | str
"""Features of a map, or why it can't be read."""


class CleanConfig(Settings):
    """Rules for a verdict."""

    by: Literal["truth", "classifier", "trees"] = "truth"
    """Who decides where the truth is known; without it, the classifier always does. ``trees`` is the paper's
    classifier, which learns from the pairs themselves."""
    seed: Counted = 0
    """Of the trees."""
    band: tuple[Share, Share] = (0.4, 0.8)
    """Probabilities from the first up to the second are doubtful and go to a person, as in the paper; until then the
    maps are dropped."""
    criteria: Criteria = field(default_factory=Criteria)
    """When a map is good by the truth."""

    def _check(self) -> None:
        if self.band[0] > self.band[1]:
            raise ConfigError(
                f"the band must be two probabilities in ascending order, not {self.band}"
            )


@dataclass(frozen=True)
class Agreement:
    """Comparison of the classifier, or of the trees, with the true coverage, where that is known."""

    count: int
    accuracy: float
    """Share of the probabilities on the right side of 1/2."""
    band_share: float
    """Share of the probabilities in the band that goes to a person."""


@dataclass(frozen=True)
class CleanReport:
    """Result of a cleaning."""

    verdicts: tuple[Verdict, ...]
    agreement: Agreement | None

    @property
    def kept(self) -> int:
        """Number of maps that are kept."""
        return sum(verdict.keep for verdict in self.verdicts)

    @property
    def undecided(self) -> int:
        """Number of doubtful maps that no person has decided about."""
        return sum(verdict.is_doubtful and verdict.by != "person" for verdict in self.verdicts)

    def reasons(self) -> dict[str, int]:
        """Number of maps that were dropped, by the kind of their first fault."""
        kinds = (verdict.kind for verdict in self.verdicts if not verdict.keep)
        return dict(Counter(kinds).most_common())


def clean_maps(
    root: Path,
    items: Sequence[MapItem],
    config: CleanConfig,
    decisions: Mapping[str, Decision],
    model_path: Path = PRETRAINED_MODEL,
    workers: int = 1,
) -> CleanReport:
    """Judge every map and write the verdicts into the folder.

    The same maps, settings and decisions give the same files, with any number of workers; they are written at the end.

    Args:
        root: Where ``clean.jsonl`` and ``clean.json`` go.
        items: The maps.
        config: The settings.
        decisions: What people decided, by the maps' names.
        model_path: The classifier.
        workers: Processes that look at the maps.

    Raises:
        ConfigError: If trees are asked for, and there is too little to learn from or scikit-learn isn't installed.
        InputFileError: If the classifier can't be read.
        StorageError: If the folder can't be written.
    """
    model = None if config.by == "trees" else CompletenessModel.read(model_path)
    seen = _measure(items, completeness_features if model else paper_features, workers)
    readable = [number for number, row in enumerate(seen) if not isinstance(row, str)]
    features = np.array([seen[number] for number in readable], dtype=np.float64)
    about: dict[str, Any] = {"model": "extra trees on the pairs themselves"}
    if model:
        said = model.probabilities(features)
        about = {"model": model_path.name, "sha256": sha256_of(model_path), **model.about}
    else:
        said = _by_trees([items[number] for number in readable], features, config)
    probability = dict(zip(readable, said.tolist(), strict=True))
    verdicts = tuple(
        _judge(item, probability.get(number, row), config, decisions)
        for number, (item, row) in enumerate(zip(items, seen, strict=True))
    )
    report = CleanReport(verdicts, _agreement(verdicts, config.band))
    write_verdicts(root, verdicts, _summary(report, config, about))
    return report


def _by_trees(items: Sequence[MapItem], features: FloatArray, config: CleanConfig) -> FloatArray:
    """Probabilities of being complete, by trees that have seen no map of the same plan."""
    least = config.criteria.min_coverage
    is_complete = [item.record.coverage >= least if item.record else None for item in items]
    plans = [item.plan_id for item in items]
    return unseen_probabilities(features, is_complete, plans, config.seed)


def _measure(items: Sequence[MapItem], features_of: _FeaturesOf, workers: int) -> list[_Seen]:
    """Look at every map."""
    seen: list[_Seen] = [""] * len(items)
    starts = range(0, len(items), _BATCH)
    numbered = [(number, item.load) for number, item in enumerate(items)]
    tasks = [(features_of, numbered[first : first + _BATCH]) for first in starts]
    with show_progress("maps", 0, len(items)) as advance:
        for rows in run_tasks(_look_at, tasks, workers if len(tasks) > 1 else 1):
            for number, row in rows:
                seen[number] = row
                advance()
    return seen


def _look_at(
    task: tuple[_FeaturesOf, list[tuple[int, Callable[[], OccupancyGrid]]]],
) -> list[tuple[int, _Seen]]:
    """Features of some maps, or why one can't be read (in a worker)."""
    features_of, numbered = task
    rows: list[tuple[int, _Seen]] = []
    for number, load in numbered:
        try:
            grid = load()
        except InputFileError as error:
            rows.append((number, str(error)))
        else:
            rows.append((number, features_of(grid.cells, grid.frame.resolution)))
    return rows


def _judge(
    item: MapItem, seen: float | str, config: CleanConfig, decisions: Mapping[str, Decision]
) -> Verdict:
    """Decide about a map.

    Args:
        item: The map.
        seen: Probability of being complete, by the classifier, or why the map can't be read.
        config: The settings.
        decisions: What people decided, by the maps' names.
    """
    record = item.record
    decision = decisions.get(item.name)
    faults: list[MapFault] = []
    if isinstance(seen, str):
        by = "file"
        faults = [MapFault("unreadable", detail=seen)]
    elif decision is not None:
        by = "person"
    elif record and config.by == "truth":
        by = "truth"
        faults = record_faults(record, config.criteria)
    else:
        by = "trees" if config.by == "trees" else "classifier"
        faults = _by_probability(seen, config.band)
    keep = not faults
    reason = "; ".join(fault.sentence for fault in faults) or "complete"
    if by == "person" and decision:
        keep = decision.keep
        reason = "kept by a person" if keep else "dropped by a person"
    return Verdict(
        name=item.name,
        keep=keep,
        reason=reason,
        by=by,
        probability=None if isinstance(seen, str) else round(seen, 4),
        is_doubtful=not isinstance(seen, str) and config.band[0] <= seen < config.band[1],
        is_complete=record.coverage >= config.criteria.min_coverage if record else None,
        coverage=record.coverage if record else None,
        ate=record.ate if record else None,
        map_error=record.map_error if record else None,
        faults=tuple(faults),
    )


def _by_probability(probability: float, band: tuple[float, float]) -> list[MapFault]:
    low, high = band
    if probability < low:
        return [MapFault("incomplete", round(probability, 4), low)]
    if probability < high:
        return [MapFault("doubtful", round(probability, 4), high)]
    return []


def _agreement(verdicts: Sequence[Verdict], band: tuple[float, float]) -> Agreement | None:
    likely = []
    complete = []
    for verdict in verdicts:
        if verdict.is_complete is not None and verdict.probability is not None:
            likely.append(verdict.probability)
            complete.append(verdict.is_complete)
    if not likely:
        return None
    low, high = band
    probabilities = np.array(likely, dtype=np.float64)
    is_right = (probabilities >= 0.5) == np.array(complete)
    is_doubtful = (probabilities >= low) & (probabilities < high)
    return Agreement(len(likely), float(is_right.mean()), float(is_doubtful.mean()))


def _summary(report: CleanReport, config: CleanConfig, about: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "version": __version__,
        "settings": dataclasses.asdict(config),
        "classifier": dict(about),
        "maps": len(report.verdicts),
        "kept": report.kept,
        "undecided": report.undecided,
        "dropped": report.reasons(),
        "agreement": report.agreement and dataclasses.asdict(report.agreement),
    }
