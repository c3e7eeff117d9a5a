"""``slamgym dataset clean`` and ``review``: which maps are complete and true enough to keep, also by a person."""

from __future__ import annotations

import contextlib
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from slamgym.commands.frame import Out
from slamgym.commands.settings import AllSettings, SettingsOptions
from slamgym.core.config import Arguments, CountOrZero
from slamgym.core.documents import read_json
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import exclusive_lock, write_text
from slamgym.core.parallel.backlog import available_cores
from slamgym.core.progress import counted, say, tell
from slamgym.dataset.curate.verdicts import Which

if TYPE_CHECKING:
    from slamgym.dataset.curate.cleaning import CleanReport
    from slamgym.dataset.curate.map_items import MapItem
    from slamgym.dataset.curate.review import Decision


class CleanArguments(Arguments):
    """Judge every map and write the verdicts to DATASET/clean.jsonl. Nothing is deleted.

    Where the truth is known (pairs that `slamgym generate` made), it decides; on maps from elsewhere, a classifier
    of completeness does. Decisions of a person overrule both.
    """

    dataset: tyro.conf.Positional[Path]
    """A dataset, or a folder of ROS maps (.yaml)."""
    apply: tuple[Path, ...] = ()
    """Files of decisions from `slamgym dataset review`; they are kept in DATASET/decisions.json, take the place of
    earlier ones about the same maps, and hold for later runs as well."""
    model: Path | None = None
    """A trained classifier (.json); the pretrained one by default."""
    workers: CountOrZero = 0
    """Processes that look at the maps; 0 takes one per core."""
    settings: AllSettings = SettingsOptions()
    """Who decides where the truth is known (``by=classifier``, ``by=trees``), when a map is good by it (``criteria``),
    and which probabilities go to a person (``band``)."""


def main(arguments: CleanArguments) -> None:
    """Run the command."""
    from slamgym.dataset.curate.cleaning import CleanConfig, clean_maps
    from slamgym.dataset.curate.completeness_model import PRETRAINED_MODEL
    from slamgym.dataset.curate.map_items import open_items
    from slamgym.dataset.format import Layout, is_dataset

    root = arguments.dataset
    config = arguments.settings.configured(CleanConfig(), {})
    if arguments.model and config.by == "trees":
        raise ConfigError("by=trees learns from the pairs themselves; leave out --model")
    # Folders of maps from elsewhere have no lock.
    with exclusive_lock(Layout(root).lock) if is_dataset(root) else contextlib.nullcontext():
        items = open_items(root)
        decisions = _decisions(arguments, items)
        model = arguments.model or PRETRAINED_MODEL
        report = clean_maps(
            root, items, config, decisions, model, arguments.workers or available_cores()
        )
    _print(root, report)


def _decisions(arguments: CleanArguments, items: Sequence[MapItem]) -> dict[str, Decision]:
    """Decisions of people, before and now; new ones are stored."""
    from slamgym.dataset.curate.review import (
        DECISIONS_FILE,
        check_decisions,
        combine,
        read_decisions,
        store_decisions,
        stored_decisions,
    )

    root = arguments.dataset
    digests = {item.name: item.digest for item in items}
    stored = stored_decisions(root)
    applied = {str(path): read_decisions(path) for path in arguments.apply}
    check_decisions(list(stored.values()), digests, str(root / DECISIONS_FILE))
    for where, decisions in applied.items():
        check_decisions(decisions, digests, where)
    if not applied:
        return stored
    fresh = combine(list(applied.values()), list(applied))
    merged = stored | fresh
    store_decisions(root, merged.values())
    say(f"{len(fresh)} decisions applied, {len(merged)} in all.")
    return merged


def _print(root: Path, report: CleanReport) -> None:
    """Say what was kept, what not and why, and how far the classifier can be trusted."""
    from slamgym.dataset.curate.verdicts import VERDICTS_FILE

    total = len(report.verdicts)
    share = 100.0 * report.kept / max(total, 1)
    lines = [f"{root}: {counted(total, 'map')}, {report.kept} kept ({share:.1f} %)"]
    for reason, count in report.reasons().items():
        lines.append(
            f"  {count:5d} " + (reason if reason.startswith("dropped") else f"dropped: {reason}")
        )
    score = report.agreement
    if score:
        lines.append(
            f"  the classifier agrees with the truth on {100.0 * score.accuracy:.1f} % of "
            f"{counted(score.count, 'map')}; {100.0 * score.band_share:.1f} % are doubtful to it"
        )
    if report.undecided:
        lines.append(
            f"  doubtful maps unseen by people: {report.undecided}; slamgym dataset review {root}"
        )
    lines.append(f"verdicts: {root / VERDICTS_FILE}")
    tell(*lines)


class ReviewArguments(Arguments):
    """Write one HTML file in which a person keeps or drops maps by a key each.

    The file holds everything, some 10 kB a map: send it, open it from a disk, come back to it later. What it saves as
    decisions.json is applied by `slamgym dataset clean DATASET --apply decisions.json`.
    """

    dataset: tyro.conf.Positional[Path]
    """A dataset or a folder of maps that `slamgym dataset clean` has judged."""
    out: Out = Path("review.html")
    """The page."""
    which: Which = "doubtful"
    """``doubtful``: in the classifier's band; ``disagreements``: the classifier and the truth differ;
    ``dropped``, ``kept`` or ``all``."""


def review(arguments: ReviewArguments) -> None:
    """Run ``slamgym dataset review``."""
    from slamgym.dataset.curate.map_items import open_items
    from slamgym.dataset.curate.review import choose_entries, make_review_page, stored_decisions
    from slamgym.dataset.curate.verdicts import read_verdicts

    root = arguments.dataset
    items = open_items(root)
    verdicts = read_verdicts(root)
    missing = sum(item.name not in verdicts for item in items)
    if missing:
        say(
            f"{counted(missing, 'map')} came after the verdicts; run `slamgym dataset clean {root}`."
        )
    entries = choose_entries(items, verdicts, arguments.which)
    if not entries:
        tell(f"{root}: no map is {_words(arguments.which)}; there is nothing to review.")
        return
    page = make_review_page(
        f"Review of {root.resolve().name}",
        f"slamgym dataset clean {shlex.quote(str(root))} --apply decisions.json",
        entries,
        _band(root),
        stored_decisions(root),
    )
    write_text(arguments.out, page)
    tell(f"{arguments.out}: {counted(len(entries), 'map')}, {len(page) / 1e6:.1f} MB")


def _band(root: Path) -> tuple[float, float]:
    """The band that the last cleaning used."""
    from slamgym.dataset.curate.cleaning import CleanConfig
    from slamgym.dataset.curate.verdicts import SUMMARY_FILE

    path = root / SUMMARY_FILE
    if not path.is_file():
        return CleanConfig().band
    try:
        summary = read_json(path)
        low, high = (float(value) for value in summary["settings"]["band"])
    except (ValueError, KeyError, TypeError, OverflowError) as error:
        raise InputFileError(
            path, f"is malformed ({error}); run `slamgym dataset clean` again"
        ) from error
    return low, high


def _words(which: Which) -> str:
    return {"disagreements": "judged differently by truth and classifier", "all": "there"}.get(
        which, which
    )
