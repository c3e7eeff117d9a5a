"""Everything that decides a training run, saved next to it as JSON: of frontier decisions, and of the wheels."""

from dataclasses import field
from typing import Any, Literal

from slamgym.cad.plan_filter import AREA
from slamgym.core.config import (
    Count,
    CountOrZero,
    NonNegative,
    Positive,
    PositiveShare,
    Seed,
    Settings,
    Share,
)
from slamgym.envs.rewards import FRONTIER_REWARD, RewardConfig
from slamgym.sim import ClutterConfig

POLICY = "policy.safetensors"
"""Name of a policy's weights in the folder of a run ..."""
BEST = "best.safetensors"
"""... and of the best by validation."""

FURNISHED = ClutterConfig(furniture=1.0, untidiness=0.3, doors=0.5)
"""Furniture of furnished buildings: as on the track ``furnished`` of the benchmark."""

FIXED_PPO: dict[str, Any] = {
    "gae_lambda": 0.95,
    "clip_range": 0.2,
    "vf_coef": 0.5,
    "target_kl": 0.03,
}
"""Settings of PPO that no run changes: lambda of the advantages, the largest change of an action's probability in an
update, the weight of the value's error, and the divergence at which an update ends; the literature's usual values."""
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
WHEELS_GOAL = 0.98
"""An episode of driving the wheels ends at this true coverage; privileged, never observed."""
WHEELS_REWARD = RewardConfig(coverage_gain=100.0, time=0.2, collision=2.0, completion=0.0)
"""A point for each new hundredth of the floor, a fifth off per second and two for each control step in contact."""


class PPOConfig(Settings, section="ppo"):
    """Proximal policy optimisation (Schulman et al. 2017)."""

    n_steps: Count = 128
    """Decisions of each environment between two updates."""
    batch_size: Count = 256
    """Decisions in a minibatch."""
    n_epochs: Count = 6
    """Passes over a rollout."""
    learning_rate: Positive = 3e-4
    """Learning rate of Adam; falls linearly to a tenth."""
    ent_coef: NonNegative = 0.003
    """Weight of the entropy."""


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
    ppo: PPOConfig = field(default_factory=PPOConfig)
    """The learner."""
    evaluate_every: CountOrZero = 12_000
    """Decisions between two evaluations on validation plans; 0 for none."""
    evaluate_plans: Count = 16
    """Plans of an evaluation."""


class TrainConfig(RunConfig):
    """A training run on ``slamgym/ExploreFrontiers-v2``."""

    furnished: Share = 0.0
    """In this share of the environments the plans are furnished, and doors stand open in half of their doorways."""
    workers: Count = 1
    """1 runs them in this process; more gives each environment its own process."""
    localization: Literal["ground_truth", "rbpf", "pose_graph", "dead_reckoning"] = "ground_truth"
    """SLAM while training; the true pose is several times faster than the particle filter."""
    coverage_goal: PositiveShare | None = 0.995
    """An episode of training ends at this true coverage; privileged, never observed."""
    time_limit: Positive = 1000.0
    """Robot time of an episode of training [s]."""


class WheelsConfig(RunConfig):
    """A training run on ``slamgym/Explore-v2`` with the observations ``compact_far``, at true poses."""

    steps: Count = 6_000_000
    """Decisions of all environments together."""
    num_envs: Count = 32
    """Environments, all in one batch."""
    reward: RewardConfig = WHEELS_REWARD
    """Weights of the reward terms."""
    ppo: PPOConfig = PPOConfig(
        n_steps=256, batch_size=1024, n_epochs=5, learning_rate=5e-4, ent_coef=0.001
    )
    """The learner."""
    evaluate_every: CountOrZero = 250_000
    """Decisions between two evaluations on validation plans; 0 for none."""
    evaluate_plans: Count = 64
    """Plans of an evaluation."""
    evaluate_seconds: Positive = 600.0
    """Time for which each plan of an evaluation is explored [s]."""
