"""``slamgym dataset split``: put plans on the training or the test side."""

from pathlib import Path

import tyro

from slamgym.core.config import Arguments, CountOrZero
from slamgym.core.parallel.backlog import available_cores
from slamgym.core.progress import counted, tell
from slamgym.dataset.images.format import Scaling


class SplitArguments(Arguments):
    """Split a dataset by plan into training and test side and write its split.json.

    Plans that look alike (copies, mirror images, turned ones, the same home with a wall moved) stay on one side.
    The same dataset and seed give the same split; plans keep their sides when a dataset grows.
    """

    dataset: tyro.conf.Positional[Path]
    """Folder of the dataset."""
    test: float = 0.1
    """Share of the groups of plans that are for testing."""
    seed: int = 0
    """Another seed gives another split."""
    test_plans: Path | None = None
    """A file with one plan id a line: these plans, and those that look like them, are for testing."""
    scaling: Scaling = "fit"
    """How the images will be scaled (`slamgym dataset render --scaling`). fit: plans look alike whatever their
    size, which serves both; fixed: only if they are of one size."""
    workers: CountOrZero = 1
    """Processes; 0 takes one per core."""


def main(argv: list[str]) -> int:
    """Run the command; returns the exit code."""
    arguments = tyro.cli(SplitArguments, args=argv, prog="slamgym dataset split")
    from slamgym.cad.sources import read_ids
    from slamgym.dataset.curate.split import make_split, split_path

    forced = read_ids(arguments.test_plans) if arguments.test_plans is not None else []
    workers = arguments.workers or available_cores()
    table = make_split(
        arguments.dataset,
        test=arguments.test,
        seed=arguments.seed,
        forced=forced,
        scaling=arguments.scaling,
        workers=workers,
    )
    train, test = len(table.of_side("train")), len(table.of_side("test"))
    alike = len(table.plans) - table.groups
    tell(
        f"{split_path(arguments.dataset)}: {counted(train, 'plan')} for training, {test} for testing "
        f"({alike} of them a look-alike of another)"
    )
    return 0
