"""The environments of training runs, and how a trained policy explores buildings, measured as evaluations measure."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from slamgym.agents.evaluation.summary import succeeded
from slamgym.agents.evaluation.trial import Task, Trial, TrialConfig, run_trial
from slamgym.agents.plan_splits import longest_side
from slamgym.agents.pretrained_policy import LearnedExplorer, policy_loop
from slamgym.agents.rl.train_config import (
    CROP_SIDE,
    TRAINING_PARTICLES,
    TRAINING_RESOLUTION,
    TrainConfig,
    WheelsConfig,
)
from slamgym.agents.wheels import WheelsExplorer
from slamgym.cad import FloorPlan
from slamgym.envs.batch.env import BatchExploreEnv
from slamgym.envs.config import ExploreConfig, ObservationConfig, resolve_config
from slamgym.envs.explore_frontiers_env import ExploreFrontiersEnv
from slamgym.envs.rewards import RewardTerms
from slamgym.planning.promise import Promise
from slamgym.sim import ClutterConfig

_CONTACT_SECONDS = 300.0
"""Contacts are counted in so many seconds."""
_EMPTY = ClutterConfig()
"""Buildings in which nothing stands and nobody walks."""


def make_env(
    config: TrainConfig, plans: Any, clutter: ClutterConfig, reward_terms: RewardTerms | None = None
) -> ExploreFrontiersEnv:
    """The environment in which a run chooses frontiers, without wrappers.

    Args:
        config: The run.
        plans: Floor plans, a sequence or a source.
        clutter: What stands and walks in them.
        reward_terms: Terms of the user's own.
    """
    return ExploreFrontiersEnv(
        plans,
        _simulation(config, clutter),
        loop={"max_candidates": config.most_frontiers, "promise": Promise()},
        discount=float(config.learner.hyperparameters.get("gamma", 1.0)),
        drive=config.drive,
        reward=config.reward,
        reward_terms=reward_terms,
        time_limit=config.time_limit,
    )


def _simulation(config: TrainConfig, clutter: ClutterConfig) -> ExploreConfig:
    """Sensors, SLAM and map of a run that chooses frontiers."""
    canvas = ObservationConfig().holding(longest_side(config.largest_area))
    settings = {
        "localization": config.localization,
        "slam": {"particles": TRAINING_PARTICLES, "resolution": TRAINING_RESOLUTION},
        "observation": {"map_resolution": TRAINING_RESOLUTION, "map_size": canvas.map_size},
        "clutter": clutter,
    }
    return resolve_config(None, settings)


def make_batch(
    config: WheelsConfig, plans: Any, reward_terms: RewardTerms | None = None
) -> BatchExploreEnv:
    """The environments in which a run drives the wheels, in one batch."""
    return BatchExploreEnv(
        config.num_envs,
        plans,
        autoreset_mode="same_step",
        localization="ground_truth",
        reward=config.reward,
        reward_terms=reward_terms,
        observation={
            "preset": "compact_far",
            "map": "global",
            "crop_px": 1,
            "crop_resolution": CROP_SIDE,
        },
        time_limit=None,
    )


def explore_plan(
    config: TrainConfig | WheelsConfig,
    policy: Path,
    plan: FloorPlan,
    seed: int,
    avoids: bool = True,
    clutter: ClutterConfig = _EMPTY,
) -> Trial:
    """Explore a building by trained weights, frontiers to the end and the wheels for ``evaluate_seconds``.

    Args:
        config: The run.
        policy: Its weights.
        plan: The building.
        seed: Of start and noise.
        avoids: See :class:`slamgym.agents.wheels.WheelsPilot`.
        clutter: What stands and walks in the building, where frontiers are chosen.
    """
    if isinstance(config, WheelsConfig):
        env = resolve_config(None, {"localization": "ground_truth"})
        return run_trial(
            Task("wheels", plan, seed),
            TrialConfig(config.evaluate_seconds / 60.0, None, env),
            lambda context: WheelsExplorer(context, policy, avoids),
        )
    return run_trial(
        Task("rl", plan, seed),
        TrialConfig("auto", Promise(), _simulation(config, clutter)),
        lambda context: LearnedExplorer(context, policy, policy_loop(Promise())),
    )


def figures_of(trial: Trial) -> dict[str, float]:
    """Figures that trainings are judged by; times [s] never reached count as the limit, paths [m] as at the end."""

    def to(level: str, reached: Mapping[str, float | None], never: float) -> float:
        found = reached[level]
        return never if found is None else found

    return {
        "time_95": to("0.95", trial.time_to, trial.time_limit),
        "time_99": to("0.99", trial.time_to, trial.time_limit),
        "path_95": to("0.95", trial.path_to, trial.path),
        "path_99": to("0.99", trial.path_to, trial.path),
        "time_done": float(trial.time if succeeded(trial) else trial.time_limit),
        "time": float(trial.time),
        "path": float(trial.path),
        "coverage": float(trial.coverage),
        "decisions": float(trial.decisions),
        "map_error": float(trial.map_error),
        "contacts": trial.collisions * _CONTACT_SECONDS / max(trial.time, 1.0),
    }


def mean_figures(trials: Sequence[Trial]) -> dict[str, float]:
    """Means over explorations of :func:`figures_of`."""
    found = [figures_of(trial) for trial in trials]
    means: dict[str, float] = {}
    for name in found[0]:
        means[name] = float(np.mean([figures[name] for figures in found]))
    return means
