"""Everything that decides a training run, saved next to it as JSON: of frontier decisions, and of the wheels."""

from dataclasses import field, replace
from typing import Literal

from slamgym.agents.rl.learner import LearnerConfig
from slamgym.cad.plan_filter import AREA
from slamgym.core.config import Count, CountOrZero, Positive, Seed, Settings, Share, suggest
from slamgym.core.errors import ConfigError
from slamgym.envs.rewards import FRONTIER_REWARD, RewardConfig
from slamgym.sim import ClutterConfig

POLICY = "policy.safetensors"
"""Name of a policy's weights in the folder of a run ..."""
BEST = "best.safetensors"
"""... and of the best by validation."""

STARTS = ("scratch", "tour")
"""Weights with which a policy that chooses frontiers begins, if not a file's."""
FURNISHED = ClutterConfig(furniture=1.0, untidiness=0.3, doors=0.5)
"""Furniture of furnished buildings: as on the track ``furnished`` of the benchmark."""

TRAINING_PARTICLES = 10
"""Particles while training, where there is a filter: fewer than an exploration has, for speed."""
TRAINING_RESOLUTION = 0.1
"""Cell size of the robot's map while training [m]: twice that of exploration halves the time, and the features are in
metres."""
CROP_SIDE = 8.4
"""Side of the map's crop that the driver of the wheels sees [m]."""
HOLD = 3
"""An action holds for so many control steps."""
DISCOUNT = 0.995
"""Of the return, per decision."""
LAYER_UNITS = (256, 128)
"""Units of the first layer, which action and value share, and of the second of each."""
WHEELS_NETWORK = {
    "crop_side": CROP_SIDE,
    "hold": HOLD,
    "first": LAYER_UNITS[0],
    "second": LAYER_UNITS[1],
}
"""Description of the network in files."""
FRONTIER_LEARNING_REWARD = replace(FRONTIER_REWARD, collision=0.0, shaping=0.0, missing=3.0)
"""A fiftieth off per second until *done*, and as much as 150 s for each hundredth of the floor missing below 98 % then.
A failure counts as the time limit, some 600 s more than a success: four hundredths."""
WHEELS_REWARD = RewardConfig(coverage_gain=100.0, time=0.2, collision=2.0, completion=0.0)
"""A point for each new hundredth of the floor, a fifth off per second and two for each control step in contact."""


_FRONTIER_PPO = {
    "n_steps": 250,
    "batch_size": 128,
    "n_epochs": 6,
    "learning_rate": "lin_1e-3",
    "gamma": 1.0,
    "gae_lambda": 0.95,
    "clip_range": 0.2,
    "ent_coef": 0.003,
    "vf_coef": 0.05,
    "max_grad_norm": 5.0,
    "target_kl": 0.05,
}
"""Of PPO on frontiers. An exploration ends after ``n_steps`` decisions at the latest; ``gamma`` is per second."""
_WHEELS_PPO = {
    "n_steps": 128,
    "batch_size": 2048,
    "n_epochs": 3,
    "learning_rate": "lin_3e-4",
    "gamma": DISCOUNT,
    "gae_lambda": 0.95,
    "clip_range": 0.2,
    "ent_coef": 0.001,
    "vf_coef": 0.5,
    "target_kl": 0.03,
}
"""Of PPO on the wheels."""
SCRATCH_PPO = {
    **_WHEELS_PPO,
    "n_steps": 256,
    "batch_size": 1024,
    "n_epochs": 5,
    "learning_rate": "lin_5e-4",
}
"""The same with larger steps, by which random weights learn something in short runs."""


class RunConfig(Settings):
    """Settings of every training run."""

    plans: tuple[str, ...] = ("procedural",)
    """Floor plans: ``procedural``, or a HouseExpo archive, ...; as many are drawn from each. Only those of the
    split ``train`` are learned on (:mod:`slamgym.agents.plan_splits`)."""
    plan_count: Count = 1500
    """So many plans are learned on."""
    largest_area: Positive = AREA[1]
    """Larger plans than this are not learned on [m2]."""
    steps: CountOrZero = 100_000
    """Decisions of all environments together that are learned from."""
    seed: Seed = 0
    """Seed of everything random."""
    num_envs: Count = 8
    """Environments."""
    reward: RewardConfig = FRONTIER_REWARD
    """Weights of the reward terms."""
    learner: LearnerConfig = field(default_factory=LearnerConfig)
    """Algorithm and hyper-parameters."""
    evaluate_every: CountOrZero = 12_000
    """Decisions between two evaluations on validation plans; 0 for none."""
    evaluate_plans: Count = 16
    """Plans of an evaluation."""


class TrainConfig(RunConfig):
    """A training run on ``slamgym/ExploreFrontiers``."""

    plans: tuple[str, ...] = ("procedural:home",)
    """Floor plans, as for every run."""
    largest_area: Positive = 80.0
    """Larger plans are not learned on [m2]: an exploration of a home of 58 m2, the mean of these, costs a third of one
    of 114 m2, and what is learned serves both."""
    steps: CountOrZero = 100_000
    """Decisions of all environments together."""
    start: str = "scratch"
    """``scratch``: weights at random, which choose at random; ``tour``: weights that choose as the rule ``tour``; or a
    file of weights, ``run/policy.safetensors``, to go on with other settings."""
    num_envs: Count = 32
    """Explorations of a rollout. 64 learned as much in each rollout, and so half as much in the same time."""
    copies: Count = 4
    """So many of them, neighbours, are of the same building, start and noise: a baseline for one another."""
    reward: RewardConfig = FRONTIER_LEARNING_REWARD
    """Weights of the reward terms."""
    learner: LearnerConfig = LearnerConfig(hyperparameters=_FRONTIER_PPO)
    """Algorithm and hyper-parameters."""
    evaluate_every: CountOrZero = 0
    """Decisions between two evaluations on validation plans, some two minutes each; 0 for none."""
    furnished: Share = 0.0
    """In this share of the environments the plans are furnished, and doors stand open in half of their doorways."""
    drive: Literal["path", "physics"] = "path"
    """``path``: along the planned path, a scan a second; ``physics``: with wheels and contacts, at a third of the
    speed (:class:`~slamgym.envs.ExploreFrontiersEnv`)."""
    localization: Literal["ground_truth", "rbpf", "pose_graph", "dead_reckoning"] = "ground_truth"
    """SLAM while training; needs ``physics`` but for the true pose."""
    workers: Count = 1
    """1 runs them in this process; more gives each environment its own process."""
    most_frontiers: Count = 20
    """So many are offered while training; explorers see up to 32."""
    time_limit: Positive = 1000.0
    """Robot time of an exploration of training [s]."""

    def _check(self) -> None:
        if self.start not in STARTS and not self.start.endswith(".safetensors"):
            raise ConfigError(
                f"start must be scratch, tour or a file of weights, not {self.start!r}; {suggest(self.start, STARTS)}"
            )
        if self.num_envs % self.copies:
            raise ConfigError(
                f"num_envs ({self.num_envs}) must be a multiple of copies ({self.copies})"
            )


class WheelsConfig(RunConfig):
    """A training run on ``slamgym/Explore-v4`` with the observations ``compact_far``, at true poses."""

    steps: CountOrZero = 700_000
    """Decisions of all environments together."""
    num_envs: Count = 96
    """Environments, all in one batch."""
    reward: RewardConfig = WHEELS_REWARD
    """Weights of the reward terms."""
    learner: LearnerConfig = LearnerConfig(hyperparameters=_WHEELS_PPO)
    """Algorithm and hyper-parameters."""
    start: Literal["scratch", "way"] = "way"
    """``scratch``: weights at random; ``way``: weights that drive to the nearest frontier."""
    evaluate_every: CountOrZero = 175_000
    """Decisions between two evaluations on validation plans; 0 for none."""
    evaluate_plans: Count = 64
    """Plans of an evaluation."""
    evaluate_seconds: Positive = 600.0
    """Time for which each plan of an evaluation is explored [s]."""


class HiddenFloorConfig(Settings):
    """A training of the network that says what frontiers hide."""

    plans: str = "json.tar.gz"
    """HouseExpo plans; a quarter of the explorations are of generated ones."""
    explorations: Count = 1800
    """Explorations of homes and small offices to learn from; some 4 s of CPU each."""
    large: CountOrZero = 100
    """And of large buildings; a minute each."""
    epochs: Count = 20
    """Passes over their frontiers."""
    seed: Seed = 7
    """Of plans, starts, and weights."""
    calibrated_on: Count = 20
    """Validation plans of each group on which the share of risk is tried."""
