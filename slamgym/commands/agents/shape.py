"""``slamgym agents shape``: compare reward presets over several seeds."""

import dataclasses
import sys
from dataclasses import field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from slamgym.agents.rl.reward_presets import WHEELS_PRESETS, ShapingConfig, WheelsShapingConfig
from slamgym.commands.agents.train import drives_the_wheels
from slamgym.commands.extras import LEARNING, require
from slamgym.core.config import Arguments
from slamgym.core.errors import ConfigError
from slamgym.core.progress import say, tell

if TYPE_CHECKING:
    from slamgym.agents.rl.shaping import Experiment


class _Arguments(Arguments):
    out: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None
    """Folder of the experiment."""
    list: bool = False
    """Only list the presets."""


class ShapeArguments(_Arguments):
    """Train the same policy with different rewards over several seeds and compare what comes of it.

    A run that is done is not done again: the same command goes on after Ctrl-C, and more presets or seeds add
    to what is there. ``--env explore --help`` shows the settings where the wheels are driven.
    """

    term: str = ""
    """A function of your own, as ``module:function``: it takes a StepRecord and returns a number. It is added
    to the preset ``time`` as the preset ``own``, and all are trained with the particle filter."""
    term_weight: float = 1.0
    """Its weight."""
    config: Annotated[ShapingConfig, tyro.conf.arg(name="")] = field(default_factory=ShapingConfig)
    """The experiment."""


class ShapeWheelsArguments(_Arguments):
    """Compare rewards where the policy drives the wheels, on a batch of environments.

    Interruptions are as without ``--env explore``.
    """

    env: Literal["explore"] = "explore"
    """``explore``: drive the wheels."""
    config: Annotated[WheelsShapingConfig, tyro.conf.arg(name="")] = field(
        default_factory=WheelsShapingConfig
    )
    """The experiment."""


def main(argv: list[str]) -> int:
    """Run the command; returns the exit code."""
    kind: type[ShapeArguments | ShapeWheelsArguments] = (
        ShapeWheelsArguments if drives_the_wheels(argv) else ShapeArguments
    )
    arguments = tyro.cli(kind, args=argv, prog="slamgym agents shape")
    if arguments.list:
        from slamgym.agents.rl.reward_presets import REWARD_PRESETS

        names = WHEELS_PRESETS if kind is ShapeWheelsArguments else tuple(REWARD_PRESETS)
        shown = {name: REWARD_PRESETS[name].about for name in names}
        width = max(map(len, shown))
        for name, about in shown.items():
            tell(f"{name:<{width}}  {about}")
        return 0
    if arguments.out is None:
        raise ConfigError("give the folder of the experiment: -o FOLDER (or --list to see the presets)")
    require(LEARNING, "slamgym agents shape")
    from slamgym.agents.rl.shaping import (
        DECISION_REPORT,
        FEW_SEEDS,
        WHEELS_REPORT,
        run_shaping,
        write_shaping_report,
    )

    if isinstance(arguments, ShapeWheelsArguments):
        experiment, form = _wheels(arguments), WHEELS_REPORT
    else:
        experiment, form = _decisions(arguments), DECISION_REPORT
    if arguments.config.seeds < FEW_SEEDS:
        say(
            f"with {arguments.config.seeds} of at least {FEW_SEEDS} seeds, the intervals say nothing of other trainings"
        )
    runs = run_shaping(experiment, arguments.out)
    sys.stdout.write(write_shaping_report(runs, form, arguments.out))
    say(f"table: {arguments.out}")
    return 0


def _decisions(arguments: ShapeArguments) -> "Experiment":
    from slamgym.agents.rl.reward_presets import OWN
    from slamgym.agents.rl.shaping import Experiment, own_term
    from slamgym.agents.rl.train import train

    config, term = arguments.config, None
    if arguments.term:
        term = own_term(arguments.term, arguments.term_weight)
        if OWN not in config.presets:
            config = dataclasses.replace(config, presets=(*config.presets, OWN))
    elif OWN in config.presets:
        raise ConfigError(f"the preset {OWN!r} needs --term module:function")
    return Experiment(config, train, term)


def _wheels(arguments: ShapeWheelsArguments) -> "Experiment":
    from slamgym.agents.rl.shaping import Experiment
    from slamgym.agents.rl.wheels import train_wheels

    return Experiment(arguments.config, train_wheels)
