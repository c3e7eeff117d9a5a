"""``slamgym agents record``: explorations as a Minari dataset, for offline reinforcement learning."""

from __future__ import annotations

import contextlib
import os
import re
import warnings
from typing import TYPE_CHECKING, Any, Literal

from slamgym.commands.frame import LEARNING, Extra, MaybeOut, require
from slamgym.core.config import Arguments, Count, CountOrZero, Share
from slamgym.core.errors import ConfigError
from slamgym.core.progress import counted, show_progress, tell

if TYPE_CHECKING:
    import numpy as np
    from minari.data_collector import EpisodeBuffer

OFFLINE = Extra("offline", ("minari", "pyarrow"))
ENVIRONMENT = "slamgym/ExploreFrontiers-v4"
_ID = re.compile(r"(\w[\w-]*/)*\w[\w-]*-v\d+")
LOCALIZATION = {"slam": "pose_graph", "ground_truth": "ground_truth"}


class RecordArguments(Arguments):
    """Record explorations as a Minari dataset: observations, choices and rewards of slamgym/ExploreFrontiers-v4.

    `minari.load_dataset(ID)` reads it, and so do the libraries for offline reinforcement learning. The same seed gives
    the same episodes.
    """

    minari: str
    """Id of the dataset: NAMESPACE/NAME-vN, such as homes/next-best-view-v0."""
    out: MaybeOut = None
    """Folder of Minari datasets; by default Minari's own (MINARI_DATASETS_PATH, or ~/.minari/datasets)."""
    plans: str = "bundled"
    """Floor plans, as `slamgym generate` takes them."""
    episodes: Count = 20
    """Explorations."""
    random_share: Share = 0.1
    """So many choices are drawn at random instead, so that the data hold other choices, too."""
    localization: Literal["slam", "ground_truth"] = "slam"
    """``slam`` maps with the pose graph; ``ground_truth`` is faster."""
    seed: CountOrZero = 0
    """Decides plans, starts, noise and random choices."""


def main(arguments: RecordArguments) -> None:
    """Run the command."""
    require(OFFLINE, "slamgym agents record")
    require(LEARNING, "slamgym agents record")
    if not _ID.fullmatch(arguments.minari):
        raise ConfigError(
            f"--minari {arguments.minari!r} is no id; give one such as homes/next-best-view-v0"
        )
    if arguments.out is not None:
        os.environ["MINARI_DATASETS_PATH"] = str(
            arguments.out.absolute()
        )  # the only way that Minari offers
    import gymnasium as gym
    import minari
    import numpy as np

    import slamgym  # noqa: F401 - registers the environments

    where = LOCALIZATION[arguments.localization]
    with contextlib.closing(
        gym.make(ENVIRONMENT, plans=arguments.plans, localization=where)
    ) as env:
        rng = np.random.default_rng(arguments.seed)
        recorded = []
        with show_progress("episodes", 0, arguments.episodes) as advance:
            for number in range(arguments.episodes):
                recorded.append(_record_episode(env, arguments, rng, number))
                advance()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter(
                    "ignore", UserWarning
                )  # Minari misses author, code and scores
                # Not by Minari's DataCollector, which would need jax.
                dataset = minari.create_dataset_from_buffers(
                    dataset_id=arguments.minari,
                    buffer=recorded,
                    env=env,
                    algorithm_name=f"next_best_view, {100 * arguments.random_share:g} % at random",
                    description=f"{counted(arguments.episodes, 'exploration')} of {arguments.plans}",
                    data_format="arrow",
                )
        except ValueError as error:
            reason = " ".join(str(error).split())
            raise ConfigError(f"--minari {arguments.minari}: {reason}; choose another id") from None
    episodes = counted(dataset.total_episodes, "episode")
    steps = counted(dataset.total_steps, "step")
    tell(f"{arguments.minari}: {episodes}, {steps}")


def _record_episode(
    env: Any, arguments: RecordArguments, rng: np.random.Generator, number: int
) -> EpisodeBuffer:
    """Explore one building."""
    import numpy as np
    from minari.data_collector import EpisodeBuffer

    from slamgym.agents.rules import NextBestView

    seed = arguments.seed + number
    observation, _ = env.reset(seed=seed)
    rule = NextBestView()
    observations = [observation]
    steps: list[tuple[int, float, bool, bool]] = []
    while not steps or not any(steps[-1][2:]):
        at_random = rng.random() < arguments.random_share
        offered = (observation["mask"] > 0.5).nonzero()[0]
        scores = rule(env.unwrapped.loop)[env.unwrapped.order] if len(offered) else [0.0]
        best = int(np.argmax(scores))  # of the rows
        action = int(rng.choice(offered)) if at_random and len(offered) else best
        observation, reward, terminated, truncated, _ = env.step(action)
        observations.append(observation)
        steps.append((action, float(reward), terminated, truncated))
    actions, rewards, terminations, truncations = map(list, zip(*steps, strict=True))
    return EpisodeBuffer(
        id=number,
        seed=seed,
        observations={key: np.stack([one[key] for one in observations]) for key in observation},
        actions=np.array(actions),
        rewards=rewards,
        terminations=terminations,
        truncations=truncations,
    )
