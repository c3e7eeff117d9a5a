"""``slamgym dataset clean``: decide which maps are complete and true enough to keep."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
import tyro

from slamgym.core.config import Arguments, CountOrZero
from slamgym.core.errors import ConfigError
from slamgym.core.files import exclusive_lock
from slamgym.core.parallel.backlog import available_cores
from slamgym.core.progress import counted, say, tell
from slamgym.dataset.faults import Criteria

if TYPE_CHECKING:
    from slamgym.dataset.curate.cleaning import CleanConfig, CleanReport
    from slamgym.dataset.curate.completeness_model import ProbabilityScore
    from slamgym.dataset.curate.map_items import MapItem
    from slamgym.dataset.curate.review import Decision


class CleanArguments(Arguments):
    """Judge every map and write the verdicts to DATASET/clean.jsonl. Nothing is deleted.

    Where the truth is known (pairs that `slamgym generate` made), it decides; on maps from elsewhere, a stuck
    filter and a classifier of completeness do. Decisions of a person overrule both.
    """

    dataset: tyro.conf.Positional[Path]
    """A dataset, or a folder of ROS maps (.yaml)."""
    apply: tuple[Path, ...] = ()
    """Files of decisions from `slamgym dataset review`; they are kept in DATASET/decisions.json and hold for
    later runs as well."""
    override: bool = False
    """Let --apply change decisions that were applied before, instead of naming the conflicts."""
    by: Literal["truth", "classifier"] = "truth"
    """Who decides where the truth is known."""
    keep_band: tuple[float, float] = (0.4, 0.8)
    """Probabilities of being complete from the first up to the second are doubtful and go to a person."""
    doubtful: Literal["drop", "keep"] = "drop"
    """What becomes of doubtful maps until a person has decided, where the classifier decides."""
    model: Path | None = None
    """A trained classifier (.npz); the pretrained one by default."""
    workers: CountOrZero = 0
    """Processes that look at the maps; 0 takes one per core."""
    criteria: Criteria = field(default_factory=Criteria)
    """When a map is good by the truth."""


def main(argv: list[str]) -> int:
    """Run the command; returns the exit code."""
    arguments = tyro.cli(CleanArguments, args=argv, prog="slamgym dataset clean")
    from slamgym.dataset.curate.cleaning import CleanConfig, clean_maps
    from slamgym.dataset.curate.completeness_model import PRETRAINED_MODEL
    from slamgym.dataset.curate.map_items import open_items

    config = CleanConfig(
        by=arguments.by,
        band=arguments.keep_band,
        doubtful=arguments.doubtful,
        criteria=arguments.criteria,
    )
    root = arguments.dataset
    with _locked(root):
        items = open_items(root)
        decisions = _decisions(arguments, items)
        model = arguments.model or PRETRAINED_MODEL
        report = clean_maps(root, items, config, decisions, model, arguments.workers or available_cores())
    _print(root, report, config)
    return 0


@contextlib.contextmanager
def _locked(root: Path) -> Iterator[None]:
    """Keep other writers out of a dataset; folders of maps from elsewhere have no lock."""
    from slamgym.dataset.format import Layout, is_dataset

    if not is_dataset(root):
        yield
        return
    with exclusive_lock(Layout(root).lock):
        yield


def _decisions(arguments: CleanArguments, items: Sequence[MapItem]) -> dict[str, Decision]:
    """What people decided before and now; what is new is stored."""
    from slamgym.dataset.curate.review import (
        DECISIONS_FILE,
        check_decisions,
        combine,
        read_decisions,
        store_decisions,
        stored_decisions,
    )

    root, digests = arguments.dataset, {item.name: item.digest for item in items}
    stored = stored_decisions(root)
    check_decisions(stored.values(), digests, str(root / DECISIONS_FILE))
    if not arguments.apply:
        return stored
    files = [read_decisions(path) for path in arguments.apply]
    for path, decisions in zip(arguments.apply, files, strict=True):
        check_decisions(decisions, digests, str(path))
    fresh = combine(files, [str(path) for path in arguments.apply])
    if arguments.override:
        merged = {**stored, **fresh}
    else:
        names = [str(root / DECISIONS_FILE), *map(str, arguments.apply)]
        try:
            merged = combine([stored.values(), fresh.values()], names)
        except ConfigError as error:
            raise ConfigError(f"{error}, or let the new ones win with --override") from None
    store_decisions(root, merged.values())
    say(f"{len(fresh)} decisions applied, {len(merged)} in all.")
    return merged


def _print(root: Path, report: CleanReport, config: CleanConfig) -> None:
    """Say what was kept, what not and why, and how far the classifier can be trusted."""
    from slamgym.dataset.curate.verdicts import VERDICTS_FILE

    total = len(report.verdicts)
    lines = [
        f"{root}: {counted(total, 'map')}, {report.kept} kept ({100.0 * report.kept / max(total, 1):.1f} %)"
    ]
    for reason, count in report.reasons().items():
        lines.append(f"  {count:5d} " + (reason if reason.startswith("dropped") else f"dropped: {reason}"))
    if report.agreement:
        lines += _agreement_lines(report.agreement, config.band)
    if report.undecided:
        lines.append(
            f"  doubtful maps that no person has seen: {report.undecided}; slamgym dataset review {root}"
        )
    lines.append(f"verdicts: {root / VERDICTS_FILE}")
    tell(*lines)


def _agreement_lines(score: ProbabilityScore, band: tuple[float, float]) -> list[str]:
    ranking = "" if np.isnan(score.roc_auc) else f", AUC {score.roc_auc:.3f}"
    outside = "" if np.isnan(score.accuracy_outside_band) else f"{100.0 * score.accuracy_outside_band:.1f} %"
    return [
        f"  the classifier agrees with the truth on {100.0 * score.accuracy:.1f} % of {counted(score.count, 'map')}"
        f"{ranking}, Brier score {score.brier:.3f}",
        f"  {100.0 * score.band_share:.1f} % lie in its band of {band[0]:g} to {band[1]:g}"
        + (f"; of the others it gets {outside} right" if outside else ""),
    ]
