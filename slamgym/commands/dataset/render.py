"""``slamgym dataset render``: make uniform square images for training."""

from __future__ import annotations

from dataclasses import field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from slamgym.commands.frame import Out
from slamgym.core.config import Arguments, CountOrZero
from slamgym.core.errors import ConfigError
from slamgym.core.parallel.backlog import available_cores
from slamgym.core.progress import counted, say, tell
from slamgym.dataset.images.square_images import ImageConfig

if TYPE_CHECKING:
    from slamgym.dataset.images.render import Selection


class RenderArguments(Arguments):
    """Make square images of one size from the explorations of a dataset: train/A, train/B, test/A, test/B.

    A is the CAD map, B the SLAM map, in one frame. Pairs that `slamgym dataset clean` dropped are left out.
    The sides follow split.json, which is made if it is missing. Nothing is simulated again; run the
    command again to resume.
    """

    dataset: tyro.conf.Positional[Path]
    """Folder of the dataset."""
    out: Out
    """Folder of the images; made if it is missing, continued if it holds images made alike."""
    images: Annotated[ImageConfig, tyro.conf.arg(name="")] = field(default_factory=ImageConfig)
    """Size, scale and content of the images."""
    min_coverage: float | None = None
    """Take all pairs of at least this true coverage instead of what `clean` has decided; 0 takes all."""
    workers: CountOrZero = 0
    """Processes; 0 takes one per core."""


def main(arguments: RenderArguments) -> None:
    """Run the command."""
    workers = arguments.workers or available_cores()
    render_and_report(
        arguments.dataset, arguments.out, arguments.images, arguments.min_coverage, workers
    )


def render_and_report(
    dataset: Path, out: Path, config: ImageConfig, min_coverage: float | None, workers: int
) -> None:
    """Render what is good enough, on the sides that the split gives, and say what came of it.

    Raises:
        ConfigError: If no pair is good enough, or the folder holds something else.
        InputFileError: If a file of the dataset is missing or malformed.
        StorageError: If the folder can't be written.
    """
    from slamgym.dataset.curate.split import current_split, split_path
    from slamgym.dataset.images.format import SPLITS
    from slamgym.dataset.images.render import render_images

    selection = _select(dataset, min_coverage)
    if not split_path(dataset).is_file():
        say(
            "The dataset has no split.json yet; making one (`slamgym dataset split` sets its options)."
        )
    split = current_split(dataset)
    report = render_images(dataset, out, config, split, selection=selection, workers=workers)
    sides = ", ".join(f"{report.sides.get(side, 0)} {side}" for side in SPLITS)
    tell(f"{out}: {counted(report.images, 'pair')} of images ({sides}), {report.fresh} new")
    for reason, count in report.left_out.items():
        tell(f"  left out: {counted(count, 'pair')}, {reason}; see skipped.jsonl")
    for side in SPLITS:
        if not report.sides.get(side) and split.test < 1.0:
            say(
                f"No pair is on the side {side}: make more pairs, or run `slamgym dataset split {dataset} --test 0.3` "
                "and render into another folder."
            )


def _select(dataset: Path, min_coverage: float | None) -> Selection:
    from slamgym.dataset.images.render import select_pairs

    selection = select_pairs(dataset, min_coverage)
    total = len(selection.kept) + len(selection.left_out)
    if "by" not in selection.rule and min_coverage is None:
        say(
            f"The dataset was not cleaned: taking {len(selection.kept)} of {counted(total, 'pair')}, those that saw "
            f"{100 * selection.rule['min_coverage']:g} % of the floor (`slamgym dataset clean` decides better)."
        )
    if not selection.kept:
        raise ConfigError(
            f"{dataset}: none of the {total} pairs is good enough; try --min-coverage 0"
        )
    return selection
