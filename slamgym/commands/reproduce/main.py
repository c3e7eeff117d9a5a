"""``slamgym reproduce``: the paper's experiments from floor plans to a report, by one command."""

from pathlib import Path
from typing import Literal

from slamgym.commands.frame import Out
from slamgym.core.config import Arguments, CountOrZero
from slamgym.core.errors import ConfigError
from slamgym.core.parallel.backlog import available_cores
from slamgym.core.progress import tell


class ReproduceArguments(Arguments):
    """Repeat the experiments of Daher et al. from floor plans to a report, with what the paper lacks.

    Plans, explorations, pairs, cleaning, translators, the parametric model, drawings, explorers; OUT/report.html shows
    the paper's tables, figures and claims next to those of this run. Run the command again to resume.
    """

    out: Out
    """Folder of everything that is made."""
    scale: Literal["smoke", "laptop", "full"] = "smoke"
    """``smoke``: 24 explorations of bundled plans by the recipe ``quick``, minutes. ``laptop``: 480 of HouseExpo's by
    ``paper``, over an hour of a core. ``full``: 10,000, some hours."""
    plans: str | None = None
    """Other floor plans than the scale's, as `slamgym generate` takes them."""
    train: bool = False
    """Also train translators on one part of the plans: slam2cad, and the paper's two in their sizes for a CPU. Without
    it the pretrained ones are measured on all."""
    seed: CountOrZero = 1
    """Seed of everything random."""
    workers: CountOrZero = 0
    """Processes; 0 takes one per core."""


def main(arguments: ReproduceArguments) -> None:
    """Run the command.

    Raises:
        SlamgymError: If the plans are missing, a step fails, or the folder holds another reproduction.
    """
    from slamgym.commands.reproduce.report import write_reproduction
    from slamgym.commands.reproduce.steps import REPRODUCTION_SCALES, Reproduction

    scale = dict(REPRODUCTION_SCALES[arguments.scale])
    if arguments.plans is not None:
        scale["plans"] = arguments.plans
    elif scale["plans"] != "bundled" and not Path(scale["plans"]).exists():
        raise ConfigError(
            f"there is no {scale['plans']} here; run `slamgym plans fetch houseexpo`, or name --plans"
        )
    workers = arguments.workers or available_cores()
    run = Reproduction(arguments.out, scale, arguments.train, arguments.seed, workers)
    run.run_steps()
    tell(f"{write_reproduction(run)}")
