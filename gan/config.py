"""Settings of the translators: what the networks are, what they minimise, and how they are trained.

Defaults are the paper's (Daher, Chakhachiro, Asmar, *From SLAM to CAD Maps and Back Using Generative Models*), whose
networks are those of anime2clothing (Tango et al., arXiv 2008.11479); where paper and published code differ the
field's docstring says which one is taken. Ready combinations are in :mod:`slamgym.gan.presets`.
"""

from dataclasses import field
from typing import Annotated, Literal, NamedTuple

from slamgym.core.config import (
    Count,
    CountOrZero,
    NonNegative,
    Positive,
    Seed,
    Settings,
    Share,
    ShareBelowOne,
    Within,
)
from slamgym.core.errors import ConfigError

Direction = Literal["slam2cad", "cad2slam"]
Encoding = Literal["grey", "free_occupied", "rgb", "layers"]
Precision = Literal["auto", "float32", "bfloat16"]
DeviceName = Literal["auto", "cpu", "cuda", "mps"]
LossForm = Literal["lsgan", "printed"]

CHANNELS: dict[Encoding, int] = {"grey": 1, "free_occupied": 2, "rgb": 3, "layers": 4}
"""Channels of a map in each encoding; all values lie in [-1, 1]."""

TRANSLATION_BATCH = 8
"""Maps that go through a generator at once."""
MIN_RESOLUTION = 8
"""Smallest side of an image [px]."""
MAX_SIZE = 1024
"""Largest side of an image [px]."""
MAX_WIDTH = 1_000_000
"""Channels that settings in a file of unknown origin may ask for."""
FOLD = 2
"""So many pixels a side become channels of one where a ``residual`` generator begins."""
Side = Annotated[int, Within(ge=MIN_RESOLUTION, le=MAX_SIZE, power_of_two=True)]


class Stage(NamedTuple):
    """A span of training at one output resolution."""

    resolution: Side
    """Side of the output [px]."""
    epochs: Positive
    """Passes over the data at this resolution, the fade-in included."""
    batch: Count
    fade_epochs: NonNegative = 0.0
    """Number of these epochs that fade in the new resolution."""
    fade_batch: CountOrZero = 0
    """Batch during the fade-in; 0 takes ``batch``."""


class GeneratorConfig(Settings, section="generator"):
    """The network that computes the translation."""

    kind: Literal["progressive", "residual"] = "progressive"
    """``progressive``: U-Net with a head per resolution (anime2clothing); ``residual``: one resolution,
    residual blocks, most of the work at half resolution and below."""
    width: Annotated[int, Within(ge=1, le=MAX_WIDTH)] = 32
    """Channels of the finest level; the deeper levels have up to four times as many."""
    depth: Annotated[int, Within(ge=1, le=7)] = 4
    """Halvings below the first one (``residual``); ``progressive`` always goes down to 2 x 2."""


class DiscriminatorConfig(Settings, section="discriminator"):
    """The two discriminators: of the pair (domain) and of the image alone (real/fake)."""

    width: Annotated[int, Within(ge=8, le=MAX_WIDTH)] = 128
    """Channels of the deepest levels; a level of side s has min(16 * 256 / s * width / 128, width)."""
    patch_width: Annotated[int, Within(ge=8, le=MAX_WIDTH)] = 128
    """The same for the second and third copy of the real/fake discriminator, which work at full resolution and
    make up nine tenths of its cost."""


class LossConfig(Settings, section="loss"):
    """Weights of the terms; a term of weight 0 isn't computed."""

    form: LossForm = "lsgan"
    """Of eqs. (2) to (5). ``lsgan``: squares, and weights of layers, as in the published code; ``printed``: the paper's
    logarithms, and all layers alike (:mod:`slamgym.gan.training.losses`)."""
    adversarial: NonNegative = 1.0
    """Each of the four terms of the discriminators: both are to be deceived, feature matching, input consistency."""
    l1: NonNegative = 10.0
    """Omega of the paper."""
    overlap: NonNegative = 0.0
    """Cross entropy of the layers, per pixel, and Dice: overlap of the free space and of what isn't free."""


class OptimiserConfig(Settings, section="optimiser"):
    """Adam, one for each network."""

    learning_rate: Positive = 2e-4
    beta1: ShareBelowOne = 0.55
    """The paper's; the second beta is the paper's 0.99. The published code has (0.5, 0.999)."""
    warm_up: ShareBelowOne = 0.0
    """Share of the training over which the rate rises from 0."""
    decay: Share = 0.3
    """Share of the training, at its end, over which the rate falls linearly to 0 (225 of 750 epochs)."""
    average: ShareBelowOne = 0.0
    """Decay of a moving average of the generator's weights, which then become the weights of the run; 0 keeps none."""
    clip_norm: NonNegative = 0.0
    """Largest norm of the generator's gradient; 0 doesn't clip."""

    def _check(self) -> None:
        if self.decay > 1.0 - self.warm_up:
            raise ConfigError(
                f"optimiser.decay must be at most 1 - optimiser.warm_up, not {self.decay}"
            )


class TranslatorConfig(Settings, section="translator"):
    """Settings for using a trained generator: stored with the weights."""

    direction: Direction = "slam2cad"
    input_size: Side = 256
    """Side of the image that the network sees [px]."""
    output_size: Side = 256
    """Side of the image that it gives [px]."""
    input_encoding: Encoding = "rgb"
    output_encoding: Encoding = "rgb"
    derotate: bool = False
    """Turn SLAM maps so that most walls lie along the axes before they are translated."""
    metres_per_px: tuple[Positive, Positive, Positive] = (0.04, 0.06, 0.1)
    """Smallest, middle and largest scale of the training images (5th, 50th and 95th percentile) [m/px of
    ``input_size``]."""
    generator: GeneratorConfig = field(default_factory=GeneratorConfig)

    def _check(self) -> None:
        if self.output_size > self.input_size:
            raise ConfigError(
                f"output_size {self.output_size} is larger than input_size {self.input_size}; "
                "the decoder ends at the input's size"
            )
        if (self.output_encoding == "layers") != (self.generator.kind == "residual"):
            raise ConfigError(
                "the residual generator, and no other, draws 'layers': set output_encoding to it"
            )
        if self.generator.kind == "residual":
            if self.output_size != self.input_size:
                raise ConfigError(
                    "the residual generator works at the input's size: set output_size to it"
                )
            folded = self.input_size // FOLD
            if folded >> self.generator.depth < 2:
                raise ConfigError(
                    f"generator.depth {self.generator.depth} is too much for {self.input_size} px"
                )


class TranslatorTrainingConfig(Settings):
    """Everything that decides what a training run makes, apart from the images."""

    preset: str = "model32"
    translator: TranslatorConfig = field(default_factory=TranslatorConfig)
    discriminator: DiscriminatorConfig = field(default_factory=DiscriminatorConfig)
    loss: LossConfig = field(default_factory=LossConfig)
    augment: bool = False
    """Cut windows, zoom and turn them, and give the SLAM map alone what clean simulation lacks: drift, double walls,
    gaps, coarse cells (:mod:`slamgym.gan.training.augmentation` has the amounts)."""
    flips: bool = True
    """Draw each pair in one of its eight orientations, both images alike; the paper has no augmentation."""
    optimiser: OptimiserConfig = field(default_factory=OptimiserConfig)
    stages: tuple[Stage, ...] = (Stage(32, 750.0, 64),)
    """From coarse to fine."""
    register: bool = False
    """Move each SLAM map onto its CAD map by the best similarity before anything is learnt
    (:mod:`slamgym.gan.registration`)."""
    start_from: str = ""
    """Weights that the generator starts with instead of random ones: a pretrained name, a file, or a run's folder."""
    patience: CountOrZero = 0
    """Stop after so many passes without a better wall F1 of held-out pairs, and keep the weights of the best pass; 0
    trains to the end (``slam2cad``)."""
    seed: Seed = 0
    minutes: Positive | None = None
    """Wall-clock time of the whole training; each stage gets the share of it that it has of the epochs. None goes by
    the epochs themselves."""

    def _check(self) -> None:
        resolutions = [stage.resolution for stage in self.stages]
        if not resolutions:
            raise ConfigError("stages is empty; give at least one")
        if resolutions != sorted(set(resolutions)):
            raise ConfigError(f"stages must grow: their resolutions are {resolutions}")
        if resolutions[-1] != self.translator.output_size:
            raise ConfigError(
                f"the last stage has resolution {resolutions[-1]} but output_size is {self.translator.output_size}"
            )
        for stage in self.stages:
            if stage.fade_epochs > stage.epochs:
                raise ConfigError(f"a stage can't fade in longer than it lasts: {tuple(stage)}")
        if (self.loss.overlap > 0.0) != (self.translator.output_encoding == "layers"):
            raise ConfigError(
                "loss.overlap is for layers, and only for them; set it to 0 or 1 accordingly"
            )
        if self.translator.generator.kind == "residual" and len(self.stages) > 1:
            raise ConfigError("the residual generator has one stage")
        if self.patience > 0 and self.translator.direction != "slam2cad":
            raise ConfigError("patience goes by the walls of CAD maps: set it to 0 for cad2slam")
