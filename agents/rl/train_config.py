"""Everything that decides a training run; saved beside it as JSON."""

from dataclasses import field
from typing import Literal

from slamgym.agents.scoring import NetworkConfig
from slamgym.cad.plan_filter import AREA
from slamgym.core.config import Count, CountOrZero, NonNegative, Positive, PositiveShare, Settings, Share
from slamgym.core.errors import ConfigError
from slamgym.envs.rewards import FRONTIER_REWARD, RewardConfig
from slamgym.planning.promise import Promise
from slamgym.sim import ClutterConfig, OdometryLevel

POLICY = "policy.safetensors"
"""Name of a policy's weights in the folder of a run ..."""
BEST = "best.safetensors"
"""... and of the best by validation."""

FURNISHED = ClutterConfig(furniture=1.0, untidiness=0.3, doors=0.5)
"""What stands in furnished buildings: as on the track ``furnished`` of the benchmark."""

Algorithm = Literal["maskable_ppo", "ppo"]


class Curriculum(Settings, section="curriculum"):
    """Small buildings first (Bengio et al., "Curriculum learning", ICML 2009)."""

    areas: tuple[float, ...] = (90.0, 160.0)
    """Largest free area in each stage but the last, which has all plans [m2]."""
    shares: tuple[float, ...] = (0.15, 0.4)
    """Share of the training after which each stage ends."""

    def _check(self) -> None:
        if len(self.areas) != len(self.shares):
            raise ConfigError("curriculum.areas and curriculum.shares must have the same length")
        if sorted(self.areas) != list(self.areas) or sorted(self.shares) != list(self.shares):
            raise ConfigError("curriculum.areas and curriculum.shares must ascend")

    def stage(self, share: float) -> int:
        """The stage at a share of the training, in [0, 1]."""
        return sum(share >= end for end in self.shares)


class PPOConfig(Settings, section="ppo"):
    """Proximal policy optimisation (Schulman et al. 2017)."""

    n_steps: Count = 128
    """Decisions of each environment between two updates."""
    batch_size: Count = 256
    """Decisions in a minibatch."""
    n_epochs: Count = 6
    """Passes over a rollout."""
    learning_rate: Positive = 3e-4
    """Of Adam; falls linearly, to a tenth where the wheels are driven, else to 0."""
    gae_lambda: PositiveShare = 0.95
    """Lambda of the advantages."""
    clip_range: Positive = 0.2
    """How far the probability of an action may change in an update."""
    ent_coef: NonNegative = 0.003
    """Weight of the entropy."""
    vf_coef: NonNegative = 0.5
    """Weight of the value's error."""
    target_kl: Positive = 0.03
    """An update ends where the policy has moved so far."""


class ImitationConfig(Settings, section="imitation"):
    """What is learned of one who knows the plan, before the learning from rewards."""

    decisions: CountOrZero = 0
    """So many decisions, with what each candidate costs in hindsight, are learned from; 0 for none."""
    rounds: Count = 1
    """In how many rounds; after each the policy is fitted to all, and drives in the next."""
    epochs: Count = 12
    """Passes over the decisions after each round."""


class TrainConfig(Settings):
    """A training run."""

    algo: Algorithm = "maskable_ppo"
    """``maskable_ppo`` or ``ppo``."""
    env: Literal["explore_frontiers"] = "explore_frontiers"
    """Choose frontiers; ``--env explore`` drives the wheels, with settings of its own (``--env explore --help``)."""
    plans: tuple[str, ...] = ("procedural",)
    """Floor plans: ``procedural``, or a HouseExpo archive, ...; as many are drawn from each. Only those of the
    split ``train`` are learned on (:mod:`slamgym.agents.plan_splits`)."""
    plan_count: Count = 1500
    """So many plans are learned on."""
    largest_area: Positive = AREA[1]
    """Larger plans than this are not learned on [m2]."""
    furnished: Share = 0.0
    """In this share of the environments the plans are furnished, and leaves hang in half of their doors."""
    steps: CountOrZero = 100_000
    """Decisions of all environments together that are learned from by rewards; 0 for imitation alone."""
    seed: int = 0
    """Seed of everything random."""
    num_envs: Count = 8
    """Environments."""
    workers: Count = 1
    """1 runs them in this process; more gives each environment a process of its own."""
    localization: Literal["ground_truth", "rbpf", "scan_matching", "dead_reckoning"] = "ground_truth"
    """SLAM while training; the true pose is several times faster than the particle filter."""
    odometry: OdometryLevel = "medium"
    """Errors of the wheel odometry, which matter where poses are estimated."""
    particles: Count = 10
    """Particles, where there is a filter."""
    resolution: Positive = 0.1
    """Cell size of the robot's map while training [m]: twice that of exploration halves the time, and the
    features are in metres."""
    coverage_goal: PositiveShare | None = 0.995
    """An episode of training ends at this true coverage; privileged, never observed."""
    promise: str | None = None
    """An episode also ends where an explorer with this promise says that it is done, as in ``98%:95%``; validation then
    goes by the time until done."""
    time_limit: Positive = 1000.0
    """Robot time of an episode of training [s]."""
    discount: PositiveShare = 0.998
    """Per second."""
    curriculum: Curriculum = field(default_factory=Curriculum)
    """Order of the plans."""
    reward: RewardConfig = FRONTIER_REWARD
    """Weights of the reward terms."""
    ppo: PPOConfig = field(default_factory=PPOConfig)
    """The learner."""
    network: NetworkConfig = field(default_factory=NetworkConfig)
    """The network."""
    start_from: str = ""
    """Weights to begin with: ``pretrained``, or a file that an earlier run wrote; by default those of an untrained
    network."""
    imitation: ImitationConfig = field(default_factory=ImitationConfig)
    """What is imitated first."""
    evaluate_every: CountOrZero = 12_000
    """Steps between two evaluations on validation plans; 0 for none."""
    evaluate_plans: int = 16
    """Plans of an evaluation."""
    checkpoint_every: Count = 4_000
    """Steps between two checkpoints."""

    def _check(self) -> None:
        if self.promise is not None:
            Promise.parse(self.promise)
