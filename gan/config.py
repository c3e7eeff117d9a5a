"""Settings of the translators: what the networks are, what they minimise, and how they are trained.

Defaults are the paper's (Daher, Chakhachiro, Asmar, *From SLAM to CAD Maps and Back Using Generative Models*), whose
networks are those of anime2clothing (Tango et al., arXiv 2008.11479); where paper and published code differ the
field's docstring says which one is taken. Ready combinations are in :mod:`slamgym.gan.presets`.
"""

import math
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from slamgym.core.errors import ConfigError

Direction = Literal["slam2cad", "cad2slam"]
Encoding = Literal["grey", "free_occupied", "rgb"]
Precision = Literal["auto", "float32", "bfloat16"]
DeviceName = Literal["auto", "cpu", "cuda", "mps"]
Layout = Literal["auto", "channels_last", "contiguous"]

REPEATS = 4
"""Of the cross-validation in a two-sample test; its accuracies are averaged."""

CHANNELS: dict[Encoding, int] = {"grey": 1, "free_occupied": 2, "rgb": 3}
"""Channels of a map in each encoding; all values lie in [-1, 1]."""

MIN_RESOLUTION, MAX_SIZE = 8, 1024


class Stage(NamedTuple):
    """A span of training at one output resolution."""

    resolution: int
    """Side of the output [px]."""
    epochs: float
    """Passes over the data at this resolution, the fade-in included."""
    batch: int
    fade_epochs: float = 0.0
    """How many of them fade the new resolution in."""
    fade_batch: int = 0
    """Batch during the fade-in; 0 takes ``batch``."""


@dataclass(frozen=True)
class GeneratorConfig:
    """The network that draws the translation."""

    kind: Literal["progressive", "residual"] = "progressive"
    """``progressive``: U-Net with a head per resolution (anime2clothing); ``residual``: one resolution,
    residual blocks, most of the work at half resolution and below."""
    width: int = 32
    """Channels of the finest level; the deeper levels have up to four times as many."""
    depth: int = 4
    """Halvings below the first one (``residual``); ``progressive`` always goes down to 2 x 2."""
    fold: int = 2
    """The first one (``residual``): so many pixels a side become channels of one, 2 or 4. With 4 a step costs
    far less, and fine detail has to come out of the channels."""
    displacement: bool = False
    """Predict a displacement field and undo it on the skip connections (``residual``)."""
    max_displacement_px: float = 8.0
    """Bound of each component of that field [px of the input]."""

    def __post_init__(self) -> None:
        if self.width < 1 or not 1 <= self.depth <= 7:
            raise ConfigError(
                f"generator: width must be 1 or more and depth 1 to 7, not {self.width} and {self.depth}"
            )
        if self.fold not in (2, 4):
            raise ConfigError(f"generator.fold must be 2 or 4, not {self.fold}")
        if not 0.0 < self.max_displacement_px <= 64.0:
            raise ConfigError(
                f"generator.max_displacement_px must lie between 0 and 64, not {self.max_displacement_px}"
            )


@dataclass(frozen=True)
class DiscriminatorConfig:
    """The two judges: of the pair (domain) and of the image alone (real/fake)."""

    domain: bool = True
    """Judge whether the output belongs to the input."""
    real_fake: bool = True
    """Judge patches of the output alone."""
    width: int = 128
    """Channels of the deepest levels; a level of side s has min(16 * 256 / s * width / 128, width)."""
    patch_width: int = 128
    """The same for the second and third copy of the real/fake judge, which work at full resolution and
    make up nine tenths of its cost."""
    unassociated: bool = True
    """Show the domain judge targets of other places as wrong answers."""

    def __post_init__(self) -> None:
        if self.width < 8 or self.patch_width < 8 or self.width % 8 or self.patch_width % 8:
            raise ConfigError(
                "discriminator.width and patch_width must be multiples of 8, "
                f"not {self.width} and {self.patch_width}"
            )


@dataclass(frozen=True)
class LossConfig:
    """Weights of the terms; a term of weight 0 isn't computed."""

    gan: Literal["lsgan", "bce"] = "lsgan"
    """``lsgan``: squared distance from 1 and 0 (the published code); ``bce``: logarithms as in eqs. (2), (3)."""
    domain: float = 1.0
    real_fake: float = 1.0
    real_fake_scope: Literal["all", "as_coded"] = "all"
    """``all``: every scale and every sample, eq. (3); ``as_coded``: the last scale and the last sample of the
    batch only, as the published code happens to do (for comparison)."""
    feature_matching: float = 1.0
    input_consistency: float = 1.0
    input_consistency_reference: Literal["x", "y", "none"] = "y"
    """Whose features the output's are compared to: the target's (eq. 5) or the input's (the published code)."""
    layer_weights: tuple[float, ...] = (5.0, 1.5, 1.5, 1.5, 1.0)
    """Of the first layers in feature matching and input consistency (published code; in neither paper)."""
    l1: float = 10.0
    """Omega of the paper."""
    cross_entropy: float = 0.0
    """Of free against not free, per pixel."""
    dice: float = 0.0
    """Overlap of the free space and of what isn't free."""
    edge_weight: float = 0.0
    """Pixels within two of a border count 1 + this in the cross entropy."""
    smoothness: float = 0.0
    """Squared differences of the displacement field."""

    def __post_init__(self) -> None:
        for name in ("domain", "real_fake", "feature_matching", "input_consistency", "l1"):
            _require_weight("loss", name, getattr(self, name))
        for name in ("cross_entropy", "dice", "edge_weight", "smoothness"):
            _require_weight("loss", name, getattr(self, name))
        if not self.layer_weights:
            raise ConfigError("loss.layer_weights is empty; give at least one weight")

    @property
    def adversarial(self) -> bool:
        """Whether any term needs a discriminator."""
        consistency = self.input_consistency if self.input_consistency_reference != "none" else 0.0
        return max(self.domain, self.real_fake, self.feature_matching, consistency) > 0.0


@dataclass(frozen=True)
class AugmentConfig:
    """Changes to the training pairs; those from ``turn_deg`` on touch the SLAM map alone (slam2cad)."""

    flips: bool = True
    """The eight flips and quarter turns, the same for both images and for the unassociated target."""
    zoom: float = 0.0
    """Enlarge both images by up to this share, or shrink by it."""
    shift: float = 0.0
    """Shift both images by up to this share of the side."""
    resampled: float = 1.0
    """Share of the samples that are zoomed, turned and shifted by fractions of a pixel, which moves walls by half a
    pixel at random; the others are shifted by whole pixels, as maps in use lie on their own grid."""
    turn_deg: float = 0.0
    """Standard deviation of a turn of the SLAM map [deg]; the published code turns it by up to 3."""
    specks: float = 0.0
    """Largest share of pixels that become occupied or free at random."""
    broken_walls: float = 0.0
    """Largest share of the walls that is erased in blobs."""
    unknown: float = 0.0
    """Largest share of the image that becomes unknown in blobs."""
    cut_off: float = 0.0
    """Probability that a half-plane of the SLAM map was never seen."""
    wobble_px: float = 0.0
    """Amplitude of a smooth random distortion of the SLAM map [px]: more drift than the data has."""

    def __post_init__(self) -> None:
        for name in ("zoom", "shift", "specks", "broken_walls", "unknown", "cut_off"):
            value = getattr(self, name)
            if not 0.0 <= value < 1.0:
                raise ConfigError(f"augment.{name} must lie in [0, 1), not {value}")
        if not 0.0 <= self.resampled <= 1.0:
            raise ConfigError(f"augment.resampled must lie in [0, 1], not {self.resampled}")
        if not 0.0 <= self.turn_deg <= 45.0 or not 0.0 <= self.wobble_px <= 32.0:
            raise ConfigError("augment.turn_deg must lie in [0, 45] and augment.wobble_px in [0, 32]")


@dataclass(frozen=True)
class OptimiserConfig:
    """Adam, one for each network."""

    learning_rate: float = 2e-4
    beta1: float = 0.55
    beta2: float = 0.99
    """The paper's betas; the published code has (0.5, 0.999)."""
    weight_decay: float = 0.0
    warm_up: float = 0.0
    """Share of the training over which the rate rises from 0."""
    decay: float = 0.3
    """Share of the training, at its end, over which the rate falls linearly to 0 (225 of 750 epochs)."""
    average: float = 0.0
    """Decay of a moving average of the generator's weights, which is then what is shipped; 0 keeps none."""
    clip_norm: float = 0.0
    """Largest norm of the generator's gradient; 0 doesn't clip."""

    def __post_init__(self) -> None:
        if not self.learning_rate > 0.0:
            raise ConfigError(f"optimiser.learning_rate must be positive, not {self.learning_rate}")
        for name in ("beta1", "beta2", "average", "warm_up"):
            if not 0.0 <= getattr(self, name) < 1.0:
                raise ConfigError(f"optimiser.{name} must lie in [0, 1), not {getattr(self, name)}")
        if not 0.0 <= self.decay <= 1.0 - self.warm_up:
            raise ConfigError(f"optimiser.decay must lie in [0, 1 - warm_up], not {self.decay}")


@dataclass(frozen=True)
class TranslatorConfig:
    """What a trained generator needs to be used: stored with the weights."""

    direction: Direction = "slam2cad"
    input_size: int = 256
    """Side of the image that the network sees [px]."""
    output_size: int = 256
    """Side of the image that it draws [px]."""
    input_encoding: Encoding = "rgb"
    output_encoding: Encoding = "rgb"
    derotate: bool = False
    """Turn SLAM maps so that most walls lie along the axes before they are translated."""
    flips: int = 1
    """Of how many flips and quarter turns the translation is the mean: 1, 2, 4 or 8."""
    reach: float = 0.5
    """Floor is drawn at most so far beyond what the robot saw [m], and targets end there (slam2cad); 0 draws it
    anywhere."""
    metres_per_px: tuple[float, float, float] = (0.04, 0.06, 0.1)
    """Smallest, middle and largest scale of the training images (5th, 50th and 95th percentile) [m/px of
    ``input_size``]."""
    generator: GeneratorConfig = field(default_factory=GeneratorConfig)

    def __post_init__(self) -> None:
        _require_choice("direction", self.direction, ("slam2cad", "cad2slam"))
        _require_choice("input_encoding", self.input_encoding, tuple(CHANNELS))
        _require_choice("output_encoding", self.output_encoding, tuple(CHANNELS))
        _require_power_of_two("input_size", self.input_size)
        _require_power_of_two("output_size", self.output_size)
        if self.output_size > self.input_size:
            raise ConfigError(
                f"output_size {self.output_size} is larger than input_size {self.input_size}; "
                "the decoder ends at the input's size"
            )
        if self.generator.kind == "residual":
            if self.output_size != self.input_size:
                raise ConfigError("the residual generator draws at the input's size: set output_size to it")
            if self.input_size // self.generator.fold >> self.generator.depth < 2:
                raise ConfigError(
                    f"generator.depth {self.generator.depth} is too much for {self.input_size} px"
                )
        if self.flips not in (1, 2, 4, 8):
            raise ConfigError(f"flips must be 1, 2, 4 or 8, not {self.flips}")
        if not (math.isfinite(self.reach) and self.reach >= 0.0):
            raise ConfigError(f"reach must be 0 or more, not {self.reach}")
        scales = self.metres_per_px
        if len(scales) != 3 or not all(math.isfinite(s) and s > 0.0 for s in scales):
            raise ConfigError(f"metres_per_px must be three positive numbers, not {scales}")


@dataclass(frozen=True)
class TrainConfig:
    """Everything that decides what a training run makes, apart from the images."""

    preset: str = "model32"
    translator: TranslatorConfig = field(default_factory=TranslatorConfig)
    discriminator: DiscriminatorConfig = field(default_factory=DiscriminatorConfig)
    loss: LossConfig = field(default_factory=LossConfig)
    augment: AugmentConfig = field(default_factory=AugmentConfig)
    optimiser: OptimiserConfig = field(default_factory=OptimiserConfig)
    stages: tuple[Stage, ...] = (Stage(32, 750.0, 64),)
    """From coarse to fine."""
    register: bool = False
    """Move each SLAM map onto its CAD map by the best similarity before anything is learnt
    (:mod:`slamgym.gan.registration`)."""
    start_from: str = ""
    """Weights that the generator starts with instead of random ones: a shipped name, a file, or a run's folder."""
    seed: int = 0
    minutes: float | None = None
    """Wall-clock time of a training that isn't told epochs or minutes; None goes by the stages' epochs."""
    validation: float = 0.04
    """Share of the training plans that is held out to watch the training (at most 64 pairs are looked at)."""

    def __post_init__(self) -> None:
        stages = tuple(Stage(*stage) for stage in self.stages)
        object.__setattr__(self, "stages", stages)  # JSON gives lists
        if not stages:
            raise ConfigError("stages is empty; give at least one")
        for stage in stages:
            self._check_stage(stage)
        resolutions = [stage.resolution for stage in stages]
        if resolutions != sorted(set(resolutions)):
            raise ConfigError(f"stages must grow: their resolutions are {resolutions}")
        if resolutions[-1] != self.translator.output_size:
            raise ConfigError(
                f"the last stage has resolution {resolutions[-1]} but output_size is {self.translator.output_size}"
            )
        if not 0.0 <= self.validation <= 0.5:
            raise ConfigError(f"validation must lie in [0, 0.5], not {self.validation}")
        if self.loss.smoothness > 0.0 and not self.translator.generator.displacement:
            raise ConfigError("loss.smoothness needs generator.displacement")

    @property
    def needs_unassociated(self) -> bool:
        """Whether a judge is shown targets of other places."""
        judged = self.discriminator.domain and max(self.loss.domain, self.loss.feature_matching) > 0.0
        return judged and self.discriminator.unassociated

    def _check_stage(self, stage: Stage) -> None:
        _require_power_of_two("stages.resolution", stage.resolution)
        if stage.epochs <= 0.0 or stage.batch < 1 or stage.fade_batch < 0:
            raise ConfigError(f"a stage needs positive epochs and batch, not {tuple(stage)}")
        if not 0.0 <= stage.fade_epochs <= stage.epochs:
            raise ConfigError(f"a stage can't fade in longer than it lasts: {tuple(stage)}")
        if self.translator.generator.kind == "residual" and len(self.stages) > 1:
            raise ConfigError("the residual generator has one stage")


def _require_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    if value not in choices:
        raise ConfigError(f"{name} must be one of {', '.join(choices)}, not {value!r}")


def _require_weight(section: str, name: str, value: float) -> None:
    if not (math.isfinite(value) and value >= 0.0):
        raise ConfigError(f"{section}.{name} must be 0 or more, not {value}")


def _require_power_of_two(name: str, value: int) -> None:
    if not MIN_RESOLUTION <= value <= MAX_SIZE or value & (value - 1):
        raise ConfigError(f"{name} must be a power of two from {MIN_RESOLUTION} to {MAX_SIZE}, not {value}")
