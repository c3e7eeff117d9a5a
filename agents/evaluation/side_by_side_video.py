"""Two explorers side by side on the same plan, start and noise, as a film."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from slamgym.agents.evaluation.summary import censored
from slamgym.agents.evaluation.trial import Trial, TrialConfig, explorer_in
from slamgym.cad import FloorPlan, PlanSource
from slamgym.core.types import ByteArray
from slamgym.envs import ExploreEnv
from slamgym.envs.episode import episode_steps, fitted_env
from slamgym.viz.canvas import rescaled, with_heading
from slamgym.viz.films import open_film

FPS = 20.0
SPEED = 16.0
"""Speed of the film, in multiples of the robot's."""
_LEVEL = "0.95"


def film_side_by_side(
    source: PlanSource,
    trials: Sequence[Trial],
    explorers: tuple[str, str],
    config: TrialConfig,
    path: Path,
) -> None:
    """Film two explorations side by side; the one that is done first waits for the other.

    The plan is that on which the left one gains the most, as a share, on its way to 95 % of the floor.

    Args:
        source: Floor plans.
        trials: An evaluation of both explorers.
        explorers: Left and right.
        config: Settings of the trials.
        path: MP4 to write.

    Raises:
        InputFileError: If the film can't be written.
    """
    chosen = choose_trial(trials, explorers)
    plan = source.load(chosen.plan)
    stride = max(1, round(SPEED / FPS / config.env.control_step))
    halves = [_frames(plan, chosen.seed, name, config, stride) for name in explorers]
    latest: list[ByteArray] = [next(half) for half in halves]
    with open_film(path, FPS) as show:
        while True:
            show(np.hstack(latest))
            following = [next(half, None) for half in halves]
            if all(frame is None for frame in following):
                break
            latest = [old if new is None else new for old, new in zip(latest, following, strict=True)]
        for _ in range(round(2.0 * FPS)):  # time to read the last figures
            show(np.hstack(latest))


def choose_trial(trials: Sequence[Trial], explorers: tuple[str, str]) -> Trial:
    """The left explorer's trial on the plan to film; arguments as :func:`film_side_by_side` takes them."""
    left, right = ({(t.plan, t.seed): t for t in trials if t.explorer == name} for name in explorers)

    def share(pair: tuple[str, int]) -> float:
        ours, theirs = (censored(side[pair], "time", _LEVEL) for side in (left, right))
        return ours / theirs if theirs > 0.0 else math.inf  # the very first scan showed all

    return left[min((pair for pair in left if pair in right), key=share)]


def _frames(plan: FloorPlan, seed: int, name: str, config: TrialConfig, stride: int) -> Iterator[ByteArray]:
    """Every n-th step of an exploration as a picture of half the size, with the explorer's name."""
    env = ExploreEnv(plan, fitted_env(plan, config.env, config.minutes), render_mode="rgb_array")
    start = env.reset(seed=seed, options={"plan": plan})
    explorer = explorer_in(env, name, config, seed)
    for step, _ in enumerate(episode_steps(env, explorer, start)):
        if step % stride == 0:
            yield _titled(env.render(), name)
    yield _titled(env.render(), f"{name}: done" if explorer.finished else f"{name}: time is up")


def _titled(frame: ByteArray, title: str) -> ByteArray:
    """A frame shrunk to a half of the film, with a heading."""
    return with_heading(rescaled(frame, 0.75), title)
