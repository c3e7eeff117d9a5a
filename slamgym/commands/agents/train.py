"""``slamgym agents train``: train a policy by reinforcement learning."""

import dataclasses
from pathlib import Path
from typing import Annotated

import tyro

from slamgym.agents.rl.train_config import TrainConfig
from slamgym.core.config import Arguments
from slamgym.core.progress import say


class TrainArguments(Arguments):
    """Train a policy by reinforcement learning.

    ``--plans procedural`` needs no files; give a HouseExpo archive (``--plans procedural json.tar.gz``) for
    policies that shall explore real homes. Only plans of the training split are learned on. The same command
    again goes on where a run was interrupted.
    """

    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Folder of the run."""
    config: Annotated[TrainConfig, tyro.conf.arg(name="")] = dataclasses.field(default_factory=TrainConfig)
    """The run."""


def main(argv: list[str]) -> int:
    """Run the command; returns the exit code."""
    arguments = tyro.cli(TrainArguments, args=argv, prog="slamgym agents train")
    from slamgym.agents.rl.train import train
    from slamgym.agents.rl.train_config import POLICY

    train(arguments.config, arguments.out)
    if arguments.config.env == "explore_frontiers":
        say(f"policy: {arguments.out / POLICY}")
    return 0
