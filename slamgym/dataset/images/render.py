"""The main path of ``slamgym dataset render``: explorations in, a folder of uniform images out.

Every pair of images is written by a worker (each file atomically) and then noted in a journal by the one
process that holds the lock; the manifest is made from the journal at the end. So an interrupted run continues
where it stopped, and what it left half done is done again with the same result.
"""

import hashlib
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from slamgym import __version__
from slamgym.cad import read_houseexpo
from slamgym.core.config import to_dict
from slamgym.core.errors import ConfigError
from slamgym.core.files import (
    append_line,
    drop_torn_line,
    exclusive_lock,
    own_folder,
    replace_file,
    sha256_of,
    storage_errors,
    text_lines,
    write_bytes,
)
from slamgym.core.parallel.engine import run_tasks
from slamgym.core.pictures import encode_png
from slamgym.core.progress import show_progress
from slamgym.dataset.curate.split import PlanSide, SplitTable
from slamgym.dataset.curate.verdicts import VERDICTS_FILE, read_verdicts
from slamgym.dataset.faults import MapFault
from slamgym.dataset.folder import claim_folder
from slamgym.dataset.format import SIDES, Layout, read_dataset_config, read_manifest
from slamgym.dataset.images.format import (
    IMAGES_VERSION,
    SPLITS,
    ImageLayout,
    ImageRecord,
    write_card,
)
from slamgym.dataset.images.square_images import DoesNotFitError, ImageConfig, draw_pair
from slamgym.dataset.record import GOOD_COVERAGE, PairRecord
from slamgym.interop import read_ros_map


@dataclass(frozen=True)
class Selection:
    """The pairs that are used, why the others are not, and by which rule."""

    kept: frozenset[str]
    left_out: Mapping[str, MapFault]
    rule: dict[str, Any]
    """``{"by": "clean.jsonl"}`` or ``{"min_coverage": 0.95}``."""


def select_pairs(root: Path | str, min_coverage: float | None = None) -> Selection:
    """Take the pairs that ``slamgym dataset clean`` keeps, or those of a least coverage.

    Args:
        root: The dataset.
        min_coverage: Take pairs by their true coverage instead of by ``clean.jsonl``. Where there is no such
            file either, 0.95 is taken.

    Raises:
        ConfigError: If the coverage is no share.
        InputFileError: If a file is missing or malformed, or ``clean.jsonl`` doesn't know a pair.
    """
    records = list(read_manifest(root))
    if min_coverage is None and (Path(root) / VERDICTS_FILE).is_file():
        verdicts = read_verdicts(root)
        unexpected = [record.name for record in records if record.name not in verdicts]
        if unexpected:
            raise ConfigError(
                f"{Path(root) / VERDICTS_FILE} says nothing of {unexpected[0]} and {len(unexpected) - 1} more; "
                "run `slamgym dataset clean` again"
            )
        left_out = {
            record.name: MapFault("not_clean", detail=verdicts[record.name].reason)
            for record in records
            if not verdicts[record.name].keep
        }
        rule: dict[str, Any] = {"by": VERDICTS_FILE}
    else:
        least = GOOD_COVERAGE if min_coverage is None else min_coverage
        if not 0.0 <= least <= 1.0:
            raise ConfigError(f"the least coverage must lie in [0, 1], not {least}")
        left_out = {
            r.name: MapFault("low_coverage", r.coverage, least, r.finished)
            for r in records
            if r.coverage < least
        }
        rule = {"min_coverage": least}
    kept = frozenset(record.name for record in records if record.name not in left_out)
    return Selection(kept, left_out, rule)


_CHUNK = 8
"""Pairs that a worker draws before it reports."""
JOURNAL = ".rendered.jsonl"
"""Records of what was drawn, until the manifest is made from them."""


@dataclass(frozen=True)
class RenderReport:
    """Result of a run of :func:`render_images`."""

    images: int
    """Pairs of images in the folder."""
    fresh: int
    """Pairs that this run drew."""
    left_out: dict[str, int]
    """Pairs of the dataset without images, by reason; see ``skipped.jsonl``."""
    sides: dict[str, int]
    """Pairs of images on each side of the split."""


def render_images(
    dataset: Path | str,
    out: Path | str,
    config: ImageConfig,
    split: SplitTable,
    *,
    selection: Selection | None = None,
    workers: int = 1,
) -> RenderReport:
    """Draw the images of all pairs that cleaning keeps.

    Args:
        dataset: A folder that ``slamgym generate`` has written.
        out: The folder of images; made if it is missing, continued if it holds images made alike.
        config: How the images are made.
        split: The side of every plan.
        selection: Which pairs to take; by default what ``clean`` decided (:func:`select_pairs`).
        workers: Number of processes.

    Raises:
        ConfigError: If the folder holds something else, or the split doesn't know a plan.
        InputFileError: If a file of the dataset is missing or malformed.
        StorageError: If the folder can't be written, or another run is writing to it.
    """
    dataset = Path(dataset)
    layout = ImageLayout(Path(out))
    chosen = selection or select_pairs(dataset)
    records = [record for record in read_manifest(dataset) if record.name in chosen.kept]
    _check_split(split, records)
    with storage_errors(layout.root):
        layout.root.mkdir(parents=True, exist_ok=True)
    with exclusive_lock(layout.lock):
        settings = _image_settings(dataset, config, split, chosen)
        claim_folder(layout.config, settings, "images")
        done = _read_journal(layout)
        todo = [
            record
            for record in records
            if not _is_done(layout, done.get(record.name), split, record)
        ]
        for record in todo:
            done.pop(record.name, None)
        fresh, misfits = _draw_all(dataset, layout, todo, split, config, workers, done)
        finished = [done[record.name] for record in records if record.name in done]
        left_out = {**chosen.left_out, **misfits}
        source = sha256_of(Layout(dataset).manifest)
        _finish(layout, finished, left_out, settings, source)
    return RenderReport(
        images=len(finished),
        fresh=fresh,
        left_out=dict(Counter(fault.reason for fault in left_out.values()).most_common()),
        sides=dict(Counter(record.split for record in finished)),
    )


def _image_settings(
    dataset: Path, config: ImageConfig, split: SplitTable, selection: Selection
) -> dict[str, Any]:
    """The content of the images' ``config.json``."""
    own = read_dataset_config(dataset)
    text = json.dumps(own, sort_keys=True)
    return {
        "images_version": IMAGES_VERSION,
        "version": __version__,
        "dataset": {
            "config_sha256": hashlib.sha256(text.encode()).hexdigest(),
            "edition": own.get("edition"),
        },
        "images": to_dict(config),
        "split": {"seed": split.seed, "test": split.test, "forced": list(split.forced)},
        "selection": selection.rule,
    }


def _draw_all(
    dataset: Path,
    layout: ImageLayout,
    todo: Sequence[PairRecord],
    split: SplitTable,
    config: ImageConfig,
    workers: int,
    done: dict[str, ImageRecord],
) -> tuple[int, dict[str, MapFault]]:
    """Draw what is missing; adds to ``done``. Returns how many were drawn, and why others were not."""
    for side in SPLITS:
        own_folder(layout.root / side)
        for image in SIDES:
            own_folder(layout.root / side / image)
    chunks = [
        [(record, split.plans[record.plan_id]) for record in todo[first : first + _CHUNK]]
        for first in range(0, len(todo), _CHUNK)
    ]
    draw = partial(_draw_chunk, dataset, layout, config)
    fresh = 0
    misfits: dict[str, MapFault] = {}
    with show_progress("pairs drawn", 0, len(todo)) as advance:
        for drawn in run_tasks(draw, chunks, max(1, min(workers, len(chunks)))):
            for name, found in drawn.items():
                if isinstance(found, MapFault):
                    misfits[name] = found
                else:
                    append_line(layout.root / JOURNAL, found.to_line())
                    done[name] = found
                    fresh += 1
                advance()
    return fresh, misfits


def _draw_chunk(
    dataset: Path,
    layout: ImageLayout,
    config: ImageConfig,
    pairs: Sequence[tuple[PairRecord, PlanSide]],
) -> dict[str, ImageRecord | MapFault]:
    """Draw some pairs and write their files (in a worker); their records, or why there is none."""
    drawn: dict[str, ImageRecord | MapFault] = {}
    for record, place in pairs:
        episode = Layout(dataset).episode(record.name)
        plan = read_houseexpo(episode / "plan.json")
        slam_map = read_ros_map(episode / "map.yaml")
        try:
            cad, slam, frame = draw_pair(plan, record.start[:2], slam_map, config)
        except DoesNotFitError as error:
            drawn[record.name] = error.fault
            continue
        images = {side: encode_png(image) for side, image in zip(SIDES, (cad, slam), strict=True)}
        for side, data in images.items():
            write_bytes(layout.image(place.side, side, record.name), data)
        sha256 = {side: hashlib.sha256(data).hexdigest() for side, data in images.items()}
        drawn[record.name] = ImageRecord.of_pair(record, frame, place.side, place.group, sha256)
    return drawn


def _finish(
    layout: ImageLayout,
    records: Sequence[ImageRecord],
    left_out: Mapping[str, MapFault],
    settings: Mapping[str, Any],
    source: str,
) -> None:
    """Write manifest, list of what is missing and card; remove images that are no part of the result."""
    with storage_errors(layout.root):
        wanted = {
            layout.image(record.split, side, record.name) for record in records for side in SIDES
        }
        for folder in {layout.image(split, side, "x").parent for split in SPLITS for side in SIDES}:
            for path in folder.iterdir():  # what isn't a picture is the user's
                if path.suffix == ".png" and path not in wanted:
                    path.unlink()
        replace_file(layout.manifest, "".join(record.to_line() for record in records).encode())
        skipped = (
            json.dumps({"name": name, "reason": fault.sentence}) + "\n"
            for name, fault in sorted(left_out.items())
        )
        replace_file(layout.skipped, "".join(skipped).encode())
        write_card(layout, records, left_out, settings, source)


def _is_done(
    layout: ImageLayout, drawn: ImageRecord | None, split: SplitTable, record: PairRecord
) -> bool:
    """True if a pair of images was drawn, lies on its side of the split and is whole."""
    if drawn is None:
        return False
    place = split.plans[record.plan_id]
    if drawn.split != place.side or drawn.group != place.group or drawn.seed != record.seed:
        return False
    paths = {side: layout.image(drawn.split, side, drawn.name) for side in SIDES}
    return all(
        path.is_file() and sha256_of(path) == drawn.sha256.get(side) for side, path in paths.items()
    )


def _read_journal(layout: ImageLayout) -> dict[str, ImageRecord]:
    """Records of the images that earlier runs have drawn; a line left incomplete by a killed run is cut off."""
    path = layout.root / JOURNAL
    if not path.exists():
        return {}
    drop_torn_line(path)
    records = [ImageRecord.from_line(line, where) for line, where in text_lines(path)]
    return {record.name: record for record in records}


def _check_split(split: SplitTable, records: Sequence[PairRecord]) -> None:
    unknown = [record.plan_id for record in records if record.plan_id not in split.plans]
    if unknown:
        raise ConfigError(
            f"the split doesn't know the plan {unknown[0]!r}, perhaps since the dataset has grown; "
            "run `slamgym dataset split` again"
        )
