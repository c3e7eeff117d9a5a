"""``slamgym agents train``: train a policy by reinforcement learning."""

import dataclasses
import itertools
from pathlib import Path
from typing import Annotated, Literal

import tyro

from slamgym.agents.rl.train_config import POLICY, TrainConfig, WheelsConfig
from slamgym.core.config import Arguments
from slamgym.core.progress import say

_Out = Annotated[Path, tyro.conf.arg(aliases=["-o"])]


class TrainArguments(Arguments):
    """Train a policy by reinforcement learning.

    ``--plans procedural`` needs no files; give a HouseExpo archive (``--plans procedural json.tar.gz``) for
    policies that shall explore real homes. Only plans of the training split are learned on. The same command
    again goes on where a run was interrupted. ``--env explore --help`` shows the settings of driving the wheels.
    """

    out: _Out
    """Folder of the run."""
    config: Annotated[TrainConfig, tyro.conf.arg(name="")] = dataclasses.field(default_factory=TrainConfig)
    """The run."""


class TrainWheelsArguments(Arguments):
    """Train a policy that drives the wheels, on a batch of environments.

    Plans, splits and interruptions are as without ``--env explore``.
    """

    out: _Out
    """Folder of the run."""
    env: Literal["explore"] = "explore"
    """``explore``: drive the wheels."""
    config: Annotated[WheelsConfig, tyro.conf.arg(name="")] = dataclasses.field(default_factory=WheelsConfig)
    """The run."""


def drives_the_wheels(argv: list[str]) -> bool:
    """Whether the arguments name the environment whose actions are speeds: its settings are others."""
    return "--env=explore" in argv or ("--env", "explore") in itertools.pairwise(argv)


def main(argv: list[str]) -> int:
    """Run the command; returns the exit code."""
    if drives_the_wheels(argv):
        wheels = tyro.cli(TrainWheelsArguments, args=argv, prog="slamgym agents train")
        from slamgym.agents.rl.wheels import train_wheels

        train_wheels(wheels.config, wheels.out)
        say(f"policy: {wheels.out / POLICY}")
        return 0
    arguments = tyro.cli(TrainArguments, args=argv, prog="slamgym agents train")
    from slamgym.agents.rl.train import train

    train(arguments.config, arguments.out)
    say(f"policy: {arguments.out / POLICY}")
    return 0
