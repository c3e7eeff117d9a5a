"""``slamgym agents shape``: compare reward presets over several seeds."""

import dataclasses
import sys
from dataclasses import field
from pathlib import Path
from typing import Annotated

import tyro

from slamgym.agents.rl.reward_shaping import ShapingConfig
from slamgym.commands.extras import LEARNING, require
from slamgym.core.config import Arguments
from slamgym.core.errors import ConfigError
from slamgym.core.progress import say


class ShapeArguments(Arguments):
    """Train the same policy with different rewards over several seeds and compare what comes of it.

    A run that is done is not done again: the same command goes on after Ctrl-C, and more presets or seeds add
    to what is there.
    """

    out: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None
    """Folder of the experiment."""
    list: bool = False
    """Only list the presets."""
    term: str = ""
    """A function of your own, as ``module:function``: it takes a StepRecord and returns a number. It is added
    to the preset ``time`` as the preset ``own``, and all are trained with the particle filter."""
    term_weight: float = 1.0
    """Its weight."""
    config: Annotated[ShapingConfig, tyro.conf.arg(name="")] = field(default_factory=ShapingConfig)
    """The experiment."""


def main(argv: list[str]) -> int:
    """Run the command; returns the exit code."""
    arguments = tyro.cli(ShapeArguments, args=argv, prog="slamgym agents shape")
    if arguments.list:
        from slamgym.agents.rl.reward_presets import REWARD_PRESETS

        width = max(map(len, REWARD_PRESETS))
        for name, preset in REWARD_PRESETS.items():
            sys.stdout.write(f"{name:<{width}}  {preset.about}\n")
        return 0
    if arguments.out is None:
        raise ConfigError("give the folder of the experiment: -o FOLDER (or --list to see the presets)")
    require(LEARNING, "slamgym agents shape")
    from slamgym.agents.rl.reward_shaping import FEW_SEEDS, OWN, own_term, run_shaping
    from slamgym.agents.rl.shaping_report import write_shaping_report
    from slamgym.agents.rl.train import train

    config, term = arguments.config, None
    if arguments.term:
        term = own_term(arguments.term, arguments.term_weight)
        if OWN not in config.presets:
            config = dataclasses.replace(config, presets=(*config.presets, OWN))
    elif OWN in config.presets:
        raise ConfigError(f"the preset {OWN!r} needs --term module:function")
    if config.seeds < FEW_SEEDS:
        say(
            f"with {config.seeds} of at least {FEW_SEEDS} seeds, the intervals say nothing of other trainings"
        )
    runs = run_shaping(config, arguments.out, train, term)
    sys.stdout.write(write_shaping_report(runs, arguments.out))
    say(f"table and pictures: {arguments.out}")
    return 0
