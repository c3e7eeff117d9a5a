"""``slamgym drive``: explore a building by hand, and keep the pair."""

from __future__ import annotations

from contextlib import closing
from dataclasses import field
from pathlib import Path
from typing import Annotated

import tyro

from slamgym.commands.exploration_options import ExplorationOptions
from slamgym.core.config import Arguments, Positive, Within
from slamgym.core.errors import SlamgymError
from slamgym.core.progress import tell


class DriveArguments(Arguments):
    """Drive a robot through a building with the arrow keys or W A S D, see its map grow, and keep the pair.

    Enter ends the drive and adds the pair to a dataset as `slamgym generate` makes them; each call adds one.
    """

    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Folder of the dataset; made if it is missing, continued if it holds one made with the same settings."""
    plans: str = "bundled"
    """Floor plans, as `slamgym generate` takes them."""
    minutes: Positive = 60.0
    """Limit of robot time [min]."""
    speed: Annotated[float, Within(gt=0.0, lt=1000.0)] = 4.0
    """How much faster than the robot time passes."""
    exploration: Annotated[ExplorationOptions, tyro.conf.arg(name="")] = field(
        default_factory=ExplorationOptions
    )
    """Robot, sensors, SLAM, furniture and people."""


def main(argv: list[str]) -> int:
    """Run the command; returns the exit code."""
    arguments = tyro.cli(DriveArguments, args=argv, prog="slamgym drive")
    from slamgym.agents.keyboard import Keyboard
    from slamgym.cad import open_plan_mix
    from slamgym.commands.generate import GenerateArguments, dataset_config
    from slamgym.core.parallel.engine import Execution
    from slamgym.core.types import Explorer
    from slamgym.dataset.folder import pair_names
    from slamgym.dataset.format import Layout
    from slamgym.dataset.generate.build import build_dataset
    from slamgym.dataset.statistics import describe_pairs
    from slamgym.planning import ExplorerContext
    from slamgym.viz.window import Window

    config = dataset_config(
        GenerateArguments(
            arguments.out, explorer="keyboard", minutes=arguments.minutes, exploration=arguments.exploration
        )
    )
    there = sum(1 for _ in pair_names(Layout(arguments.out).episodes))
    with closing(Window("slamgym drive", config.episode.env.lidar.rate * arguments.speed)) as window:

        def make_explorer(name: str, context: ExplorerContext, seed: int = 0) -> Explorer:  # noqa: ARG001 - you are the explorer
            return Keyboard(context, window)

        report = build_dataset(
            arguments.out,
            open_plan_mix((arguments.plans,)),
            config,
            make_explorer,
            pairs=there + 1,
            execution=Execution(engine="in_process"),
        )
    if not report.fresh:
        raise SlamgymError(f"{arguments.out}: no pair was added")
    tell(*describe_pairs(arguments.out).splitlines())
    return 0
