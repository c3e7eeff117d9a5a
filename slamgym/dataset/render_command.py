"""``slamgym dataset render``: make uniform square images for training."""

import os
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from slamgym.dataset.images import read_images
from slamgym.dataset.progress import say
from slamgym.dataset.record_table import write_parquet
from slamgym.dataset.render import render_images
from slamgym.dataset.selection import Selection, select_pairs
from slamgym.dataset.split import make_split, read_split, split_path
from slamgym.dataset.square_images import ImageConfig
from slamgym.errors import ConfigError


@dataclass(frozen=True)
class RenderArguments:
    """Make square images of one size from the explorations of a dataset: train/A, train/B, test/A, test/B.

    A is the CAD map, B the SLAM map, in one frame. Pairs that `slamgym dataset clean` dropped are left out.
    The sides follow split.json, which is made if it is missing. Nothing is simulated again, and the same
    command goes on where an interrupted one stopped.
    """

    dataset: tyro.conf.Positional[Path]
    """Folder of the dataset."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Folder of the images; made if it is missing, continued if it holds images made alike."""
    images: Annotated[ImageConfig, tyro.conf.arg(name="")] = field(default_factory=ImageConfig)
    """How the images are made."""
    min_coverage: float | None = None
    """Take all pairs of at least this true coverage instead of what `clean` has decided; 0 takes all."""
    parquet: bool = False
    """Write the manifest as manifest.parquet, too; needs pyarrow (extra `hub`)."""
    workers: int = 0
    """Processes; 0 takes one per core."""


def main(argv: list[str]) -> int:
    """Run the command; returns the exit code."""
    arguments = tyro.cli(RenderArguments, args=argv, prog="slamgym dataset render")
    if arguments.workers < 0:
        raise ConfigError(f"--workers must be 0 (one per core) or more, not {arguments.workers}")
    workers = arguments.workers or os.cpu_count() or 1
    selection = _select(arguments)
    if not split_path(arguments.dataset).is_file():
        say("The dataset has no split.json yet; making one (`slamgym dataset split` sets its options).")
        make_split(arguments.dataset, workers=workers)
    split = read_split(arguments.dataset)
    report = render_images(
        arguments.dataset, arguments.out, arguments.images, split, selection=selection, workers=workers
    )
    if arguments.parquet:
        write_parquet(arguments.out / "manifest.parquet", read_images(arguments.out))
    sides = ", ".join(f"{report.sides.get(side, 0)} {side}" for side in ("train", "test"))
    sys.stdout.write(
        f"{arguments.out}: {report.images} pairs of images ({sides}), {report.fresh} of them new\n"
    )
    for reason, count in report.left_out.items():
        sys.stdout.write(f"  left out: {count} pairs, {reason}; see skipped.jsonl\n")
    return 0


def _select(arguments: RenderArguments) -> Selection:
    selection = select_pairs(arguments.dataset, arguments.min_coverage)
    total = len(selection.kept) + len(selection.left_out)
    if "by" not in selection.rule and arguments.min_coverage is None:
        say(
            f"The dataset was not cleaned: taking {len(selection.kept)} of {total} pairs, those that saw "
            f"{100 * selection.rule['min_coverage']:g} % of the floor (`slamgym dataset clean` decides better)."
        )
    if not selection.kept:
        raise ConfigError(
            f"{arguments.dataset}: none of the {total} pairs is good enough; try --min-coverage 0"
        )
    return selection
