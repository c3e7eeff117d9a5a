"""The command: its arguments, the steps, the report."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated

import tyro

from slamgym.commands.reproduce.scales import REPRODUCTION_SCALES, ScaleName
from slamgym.core.config import Arguments, CountOrZero
from slamgym.core.errors import ConfigError
from slamgym.core.parallel.backlog import available_cores
from slamgym.core.progress import tell


class ReproduceArguments(Arguments):
    """Repeat the experiments of Daher et al. from floor plans to a report, with what the paper lacks.

    Plans, explorations, pairs, cleaning, translators, the parametric model, drawings, explorers; OUT/report.html puts
    the paper's tables, figures and claims beside those of this run. The same command goes on where it was interrupted.
    """

    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Folder of everything that is made."""
    scale: ScaleName = "smoke"
    """``smoke``: 24 maps of bundled plans, minutes. ``laptop``: 240 of HouseExpo, a quarter of an hour of a
    fast core. ``full``: 4,550, some hours."""
    plans: str | None = None
    """Other floor plans than the scale's, as `slamgym generate` takes them."""
    train: bool = False
    """Also train a translator on the training side of the pairs; without it the pretrained ones are measured."""
    seed: CountOrZero = 1
    """Of everything random."""
    workers: CountOrZero = 0
    """Processes; 0 takes one per core."""


def main(argv: list[str]) -> int:
    """Run the command; returns the exit code.

    Raises:
        SlamgymError: If the plans are missing, a step fails, or the folder holds another reproduction.
    """
    arguments = tyro.cli(ReproduceArguments, args=argv, prog="slamgym reproduce")
    scale = REPRODUCTION_SCALES[arguments.scale]
    if arguments.plans is not None:
        scale = dataclasses.replace(scale, plans=arguments.plans)
    elif scale.plans != "bundled" and not Path(scale.plans).exists():
        raise ConfigError(
            f"there is no {scale.plans} here; get it by `slamgym plans fetch houseexpo`, or name --plans"
        )
    from slamgym.commands.reproduce.report import write_reproduction
    from slamgym.commands.reproduce.steps import Reproduction, run_steps

    workers = arguments.workers or available_cores()
    run = Reproduction(arguments.out, scale, arguments.train, arguments.seed, workers)
    state = run_steps(run)
    tell(f"{write_reproduction(run, state)}")
    return 0
