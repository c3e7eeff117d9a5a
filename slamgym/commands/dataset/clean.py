"""``slamgym dataset clean``: decide which maps are complete and true enough to keep."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
import tyro

from slamgym.core.config import Arguments, CountOrZero, Within
from slamgym.core.errors import ConfigError
from slamgym.core.files import exclusive_lock, sha256_of
from slamgym.core.parallel.backlog import available_cores
from slamgym.core.progress import counted, say, tell
from slamgym.core.types import FloatArray
from slamgym.dataset.curate.completeness_model import TreesConfig
from slamgym.dataset.curate.criteria import Criteria, StuckFilter

if TYPE_CHECKING:
    from slamgym.dataset.curate.cleaning import Classifier, CleanConfig, CleanReport
    from slamgym.dataset.curate.completeness_model import ProbabilityScore
    from slamgym.dataset.curate.decisions import Decision
    from slamgym.dataset.curate.map_items import MapItem


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
    train: bool = False
    """Train on this dataset instead (needs scikit-learn): every pair is judged by a model that has seen no
    map of the same plan."""
    train_pairs: Annotated[int, Within(ge=2)] = 300
    """Explorations to train on at most, each at several moments."""
    save_model: Path | None = None
    """Where to write the model that --train made."""
    workers: CountOrZero = 0
    """Processes that look at the maps; 0 takes one per core."""
    criteria: Criteria = field(default_factory=Criteria)
    """When a map is good by the truth."""
    stuck: StuckFilter = field(default_factory=StuckFilter)
    """When a map looks like that of a robot that got stuck."""
    trees: TreesConfig = field(default_factory=TreesConfig)
    """How --train grows its trees."""

    def _check(self) -> None:
        if self.train and self.model:
            raise ConfigError("--train makes a model of its own; leave --model out")
        if self.save_model and not self.train:
            raise ConfigError("--save-model needs --train: there is no new model to save")
        if self.save_model and self.save_model.suffix != ".npz":
            raise ConfigError(f"--save-model {self.save_model}: a model is an .npz file")


def main(argv: list[str]) -> int:
    """Run the command; returns the exit code."""
    arguments = tyro.cli(CleanArguments, args=argv, prog="slamgym dataset clean")
    from slamgym.dataset.curate.cleaning import CleanConfig, clean_maps
    from slamgym.dataset.curate.map_items import open_items

    config = CleanConfig(
        by=arguments.by,
        band=arguments.keep_band,
        doubtful=arguments.doubtful,
        criteria=arguments.criteria,
        stuck=arguments.stuck,
    )
    root = arguments.dataset
    with _locked(root):
        items = open_items(root)
        decisions = _decisions(arguments, items)
        classifier, about = _classifier(arguments, items)
        report = clean_maps(
            root, items, classifier, about, config, decisions, arguments.workers or available_cores()
        )
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
    from slamgym.dataset.curate.decisions import (
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


def _classifier(arguments: CleanArguments, items: Sequence[MapItem]) -> tuple[Classifier, dict[str, Any]]:
    """What predicts the probabilities, and what to note about it."""
    from slamgym.dataset.curate.completeness_model import PRETRAINED_MODEL, CompletenessModel

    if arguments.train:
        return _train(arguments, items)
    path = arguments.model or PRETRAINED_MODEL
    model = CompletenessModel.read(path)

    def probabilities(features: FloatArray, plan_ids: Sequence[str]) -> FloatArray:  # noqa: ARG001 - of a protocol
        return model.probabilities(features)

    digest = sha256_of(path)
    return probabilities, {"model": path.name, "sha256": digest, **model.about}


def _train(arguments: CleanArguments, items: Sequence[MapItem]) -> tuple[Classifier, dict[str, Any]]:
    from slamgym.dataset.curate.completeness_model import cross_fit
    from slamgym.dataset.curate.snapshots import label_maps

    records = [item.record for item in items if item.record is not None]
    if not records:
        raise ConfigError(f"{arguments.dataset}: --train needs pairs of which the truth is known")
    count = min(arguments.train_pairs, len(records))
    chosen = [records[i] for i in np.unique(np.linspace(0, len(records) - 1, count).astype(int))]
    maps = label_maps([(arguments.dataset, record) for record in chosen], arguments.criteria, arguments.stuck)
    maps = maps.where(maps.learnable)
    models = cross_fit(maps.features, maps.complete, maps.plan_ids.tolist(), arguments.trees)
    about = {
        "model": "trained on held-out plans of this dataset",
        "explorations": len(chosen),
        "maps": len(maps),
        "complete": int(maps.complete.sum()),
        "trees": dataclasses.asdict(arguments.trees),
    }
    if arguments.save_model:
        notes = {"criteria": dataclasses.asdict(arguments.criteria)}
        dataclasses.replace(models.whole, about=models.whole.about | notes).write(arguments.save_model)
        say(f"model: {arguments.save_model}")
    return models.probabilities, about


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
