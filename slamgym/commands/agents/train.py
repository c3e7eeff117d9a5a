"""``slamgym agents train frontiers`` and ``wheels``, and ``shape``: policies learned by reinforcement."""

import dataclasses
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeVar

from slamgym.agents.rl.learner import arguments_of, parse_hyperparameters, read_hyperparameters
from slamgym.agents.rl.reward_presets import ShapingConfig
from slamgym.agents.rl.train_config import (
    POLICY,
    HiddenFloorConfig,
    RunConfig,
    TrainConfig,
    WheelsConfig,
)
from slamgym.commands.frame import LEARNING, Out, require
from slamgym.commands.settings import AllSettings, SettingsOptions
from slamgym.core.config import Arguments, Count, CountOrZero, Seed
from slamgym.core.errors import ConfigError
from slamgym.core.parallel.backlog import available_cores
from slamgym.core.progress import say

if TYPE_CHECKING:
    from slamgym.agents.rl.shaping import Experiment

_Run = TypeVar("_Run", bound=RunConfig)


class TrainArguments(Arguments):
    """Train a policy by reinforcement learning.

    ``--plans procedural`` needs no files; give a HouseExpo archive (``--plans procedural json.tar.gz``) for policies
    that explore real homes. Only plans of the training split are used. Run the command again to resume a training.
    """

    out: Out
    """Folder of the run."""
    plans: tuple[str, ...] | None = None
    """Floor plans: ``procedural``, ``procedural:home``, a HouseExpo archive, ...; as many are drawn from each."""
    plan_count: Count | None = None
    """Number of plans to learn on; by default 1,500."""
    steps: CountOrZero | None = None
    """Decisions of all environments together."""
    num_envs: Count | None = None
    """Number of environments."""
    seed: Seed | None = None
    """Seed of everything random, by default 0."""
    algo: str | None = None
    """``ppo``, the default, ``a2c``, or ``trpo`` of sb3-contrib."""
    hyperparams: tuple[str, ...] = ()
    """Hyper-parameters of the algorithm, as rl-zoo takes them: ``learning_rate:lin_1e-3 gae_lambda:0.9``."""
    conf_file: Path | None = None
    """A YAML file of them, in rl-zoo's form."""
    settings: AllSettings = SettingsOptions()
    """Localisation, reward, network, evaluation and all else."""


class FrontierArguments(TrainArguments):
    """Train a policy that chooses among frontiers, and says *done*; see ``slamgym agents train wheels`` for wheels.

    Plans as for all trainings: ``procedural:home`` needs no files. Run the command again to resume.
    """

    start: str | None = None
    """``scratch``, the default: weights at random; ``tour``: weights that choose as the rule ``tour``; or a file of
    weights, to go on with other settings."""


class WheelsArguments(TrainArguments):
    """Train a policy that drives the wheels, on a batch of environments.

    ``--plans procedural`` needs no files; only plans of the training split are used. Run the command again to resume.
    """

    start: Literal["scratch", "way"] | None = None
    """``scratch``: weights at random; ``way``, the default: weights that drive to the nearest frontier."""


def frontiers(arguments: FrontierArguments) -> None:
    """Train a policy that chooses among frontiers."""
    from slamgym.agents.rl.train import train

    config = _configured(TrainConfig(), arguments, arguments.start, "slamgym/ExploreFrontiers")
    train(config, arguments.out)
    say(f"policy: {arguments.out / POLICY}")


def wheels(arguments: WheelsArguments) -> None:
    """Train a policy that drives the wheels, on a batch of environments."""
    from slamgym.agents.rl.wheels import train_wheels

    config = _configured(WheelsConfig(), arguments, arguments.start, "slamgym/Explore-")
    train_wheels(config, arguments.out)
    say(f"policy: {arguments.out / POLICY}")


def _configured(default: _Run, arguments: TrainArguments, start: str | None, env: str) -> _Run:
    """The settings of a training.

    Raises:
        ConfigError: If a setting makes no sense, or the algorithm is unknown or takes no such hyper-parameter.
        InputFileError: If the file of hyper-parameters can't be used.
    """
    config = arguments.settings.configured(
        default,
        {
            "plans": arguments.plans,
            "plan_count": arguments.plan_count,
            "steps": arguments.steps,
            "num_envs": arguments.num_envs,
            "seed": arguments.seed,
            "start": start,
        },
    )
    values = {} if arguments.conf_file is None else read_hyperparameters(arguments.conf_file, env)
    values |= parse_hyperparameters(arguments.hyperparams)
    learner = config.learner.changed(arguments.algo, values)
    arguments_of(learner)
    return dataclasses.replace(config, learner=learner)


class HiddenFloorArguments(Arguments):
    """Train the network of the explorer ``rl``: how much floor frontiers hide, by hindsight and not by reward.

    Two hours on two cores with HouseExpo's plans. Run the command again to resume.
    """

    out: Out
    """Folder of the run: the explorations, and ``hidden_floor.safetensors``."""
    plans: str | None = None
    """HouseExpo plans, by default ``json.tar.gz``; `slamgym plans fetch` downloads them."""
    seed: Seed | None = None
    """Seed of everything random, by default 7."""
    settings: AllSettings = SettingsOptions()
    """Numbers of explorations, epochs and all else."""


def hidden_floor(arguments: HiddenFloorArguments) -> None:
    """Train the network that says what frontiers hide."""
    from slamgym.agents.rl.hidden_floor import WEIGHTS, train_hidden_floor

    options = {"plans": arguments.plans, "seed": arguments.seed}
    config = arguments.settings.configured(HiddenFloorConfig(), options)
    train_hidden_floor(config, arguments.out)
    say(f"network: {arguments.out / WEIGHTS}")


class ShapeArguments(Arguments):
    """Train by different rewards over several seeds, from scratch, and say for each pair which is better.

    Run the command again to resume; finished runs are kept, and more presets or seeds add to them.
    """

    out: Out
    """Folder of the experiment."""
    level: Literal["wheels", "frontiers"] | None = None
    """``wheels``, the default: drivers of the wheels; ``frontiers``: policies that choose frontiers."""
    workers: CountOrZero = 0
    """So many runs at a time; 0 takes one per core."""
    presets: tuple[str, ...] | None = None
    """Rewards: coverage, collision, careful, floor, path_cost, completion, potential; by default all."""
    seeds: Count | None = None
    """Runs of each preset, by default 3."""
    test_plans: Count | None = None
    """Held-out plans that every policy explores at the end."""
    term: str = ""
    """Your own function, as ``module:function``: it takes a StepRecord and returns a number. It is added
    to the preset ``coverage`` as the preset ``own``. Give another folder after a change of its code."""
    term_weight: float = 1.0
    """Its weight."""
    settings: AllSettings = SettingsOptions()
    """Each training, as ``train.steps`` or ``frontiers.steps``, and all else."""


def shape(arguments: ShapeArguments) -> None:
    """Run ``slamgym agents shape``."""
    require(LEARNING, "slamgym agents shape")
    from slamgym.agents.rl.shaping import FEW_SEEDS, run_shaping, write_shaping_report

    experiment = _experiment(arguments)
    seeds = experiment.config.seeds
    if seeds < FEW_SEEDS:
        say(
            f"with {seeds} of at least {FEW_SEEDS} seeds, the intervals say nothing of other trainings"
        )
    runs = run_shaping(experiment, arguments.out, arguments.workers or available_cores())
    sys.stdout.write(write_shaping_report(runs, arguments.out, experiment.config.level))
    say(f"table: {arguments.out}")


def _experiment(arguments: ShapeArguments) -> "Experiment":
    from slamgym.agents.rl.reward_presets import OWN
    from slamgym.agents.rl.shaping import Experiment, own_term
    from slamgym.agents.rl.train import train
    from slamgym.agents.rl.wheels import train_wheels

    options = {
        "level": arguments.level,
        "presets": arguments.presets,
        "seeds": arguments.seeds,
        "test_plans": arguments.test_plans,
    }
    config = arguments.settings.configured(ShapingConfig(), options)
    term = None
    if arguments.term:
        term = own_term(arguments.term, arguments.term_weight)
        if OWN not in config.presets:
            # First: if it fails, then at once.
            config = dataclasses.replace(config, presets=(OWN, *config.presets))
    elif OWN in config.presets:
        raise ConfigError(f"the preset {OWN!r} needs --term module:function")
    return Experiment(config, train_wheels if config.level == "wheels" else train, term)
