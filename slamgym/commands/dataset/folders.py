"""``slamgym dataset check``, ``merge``, ``split`` and ``pack``: datasets as folders."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro

from slamgym.commands.frame import Out
from slamgym.core.config import Arguments, Count, Seed
from slamgym.core.errors import ConfigError
from slamgym.core.progress import counted, show_progress, tell

if TYPE_CHECKING:
    from slamgym.dataset.merge import MergeReport

EXIT_FAULTS = 1
_SHOWN = 5
"""Missing shards that are named."""


class CheckArguments(Arguments):
    """Verify a dataset, or a folder of rendered images: files, digests, shapes, pixel values, lists.

    Every fault is one line. The exit code is 0 if there is none, else 1.
    """

    folder: tyro.conf.Positional[Path]
    """A folder that `slamgym generate` or `slamgym dataset render` has written."""


def check(arguments: CheckArguments) -> int:
    """Run ``slamgym dataset check``; returns the exit code."""
    from slamgym.dataset.check import check_dataset, check_image_folder, is_image_folder
    from slamgym.dataset.format import count_lines, require_manifest

    manifest = arguments.folder / "manifest.jsonl"
    require_manifest(manifest, "slamgym generate` or `slamgym dataset render")
    total = count_lines(manifest)
    find = check_image_folder if is_image_folder(arguments.folder) else check_dataset
    with show_progress("pairs checked", 0, total) as advance:
        faults = find(arguments.folder, advance)
    tell(*map(str, faults))
    verdict = counted(len(faults), "fault") if faults else "no fault"
    tell(f"{arguments.folder}: {counted(total, 'pair')}, {verdict}")
    return EXIT_FAULTS if faults else 0


class MergeArguments(Arguments):
    """Put the shards that ``slamgym generate --shard`` has made below a folder together, in that folder.

    Files are linked, not copied, where the file system can; the shards stay and may be removed afterwards.
    Run it again whenever shards were added. Afterwards the same ``slamgym generate`` without ``--shard`` adds
    the pairs that are missing, if explorations failed.
    """

    root: tyro.conf.Positional[Path]
    """The folder that holds the shards."""


def merge(arguments: MergeArguments) -> None:
    """Run ``slamgym dataset merge``."""
    from slamgym.dataset.merge import merge_shards
    from slamgym.dataset.statistics import describe_pairs

    report = merge_shards(arguments.root)
    tell(_describe(report), *describe_pairs(arguments.root).splitlines())


def _describe(report: MergeReport) -> str:
    lines = f"{counted(report.fresh, 'new pair')} of {counted(report.shards, 'shard')}."
    if report.missing:
        more = "" if len(report.missing) <= _SHOWN else f" and {len(report.missing) - _SHOWN} more"
        lines += f" Not there: {', '.join(report.missing[:_SHOWN])}{more}."
    if report.broken:
        lines += (
            f" Left out: {counted(len(report.broken), 'pair')} without one of its files, such as {report.broken[0]}: "
            "run `slamgym generate` for their shards again."
        )
    return lines


class SplitArguments(Arguments):
    """Split a dataset by plan into training and test side and write its split.json.

    Plans that look alike (copies, mirror images, turned ones, the same home with a wall moved) stay on one side.
    The same dataset and seed give the same split; plans keep their sides when a dataset grows.
    """

    dataset: tyro.conf.Positional[Path]
    """Folder of the dataset."""
    test: float = 0.1
    """Share of the groups of plans that are for testing."""
    seed: Seed = 0
    """Another seed gives another split."""
    test_plans: Path | None = None
    """A file with one plan id a line: these plans, and those that look like them, are for testing."""


def split(arguments: SplitArguments) -> None:
    """Run ``slamgym dataset split``."""
    from slamgym.cad.sources import read_ids
    from slamgym.dataset.curate.split import make_split, split_path

    table = make_split(
        arguments.dataset,
        test=arguments.test,
        seed=arguments.seed,
        forced=read_ids(arguments.test_plans) if arguments.test_plans is not None else [],
    )
    train = len(table.of_side("train"))
    test = len(table.of_side("test"))
    alike = len(table.plans) - table.groups
    tell(
        f"{split_path(arguments.dataset)}: {counted(train, 'plan')} for training, {test} for testing "
        f"({alike} of them a look-alike of another)"
    )


class PackArguments(Arguments):
    """Pack rendered images for publication, in a new folder: shards, card, licence, checksums (SHA256SUMS).

    The plans' licences decide under which licence the images may be given away: HouseExpo's is MIT.
    """

    images: tyro.conf.Positional[Path]
    """A folder that `slamgym dataset render` has written."""
    out: Out
    """The new folder."""
    licence: str
    """Name of the licence as the Hugging Face hub has it: mit, cc-by-4.0, ..."""
    notice: Path | None = None
    """A file with its text, which comes along as LICENSE."""
    kind: Literal["parquet", "webdataset"] = "parquet"
    """Parquet for Hugging Face's `datasets`, or tar files that `webdataset` streams."""
    pairs_per_shard: Count = 2000
    """About 30 MB at 256 pixels."""

    def _check(self) -> None:
        if not re.fullmatch(r"[a-z0-9][a-z0-9.+-]*", self.licence):
            raise ConfigError(
                f"--licence must be a name such as mit or cc-by-4.0, not {self.licence!r}"
            )


def pack(arguments: PackArguments) -> None:
    """Run ``slamgym dataset pack``."""
    from slamgym.commands.frame import PARQUET, WEBDATASET, require
    from slamgym.dataset.format import count_lines, require_manifest
    from slamgym.dataset.images.pack import pack_images

    require(PARQUET if arguments.kind == "parquet" else WEBDATASET, "slamgym dataset pack")
    manifest = arguments.images / "manifest.jsonl"
    require_manifest(manifest, "slamgym dataset render")
    with show_progress("pairs packed", 0, count_lines(manifest)) as advance:
        sides = pack_images(
            arguments.images,
            arguments.out,
            arguments.kind,
            arguments.licence,
            arguments.notice,
            arguments.pairs_per_shard,
            advance,
        )
    counts = ", ".join(f"{count} {side}" for side, count in sides.items())
    tell(f"{arguments.out}: {counted(sum(sides.values()), 'pair')} ({counts})")
