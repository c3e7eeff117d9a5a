"""Ready settings: the paper's two translators, each in a size for a CPU, too, and the default one.

``model32`` and ``modelprog`` follow Daher et al. and the schedules of its code (750 and 200 epochs). The CPU sizes keep
losses, discriminators and schedule but have narrower networks and smaller images, and a span of minutes.
"""

from dataclasses import replace

from slamgym.core.config import suggest
from slamgym.core.errors import ConfigError
from slamgym.gan.config import (
    DiscriminatorConfig,
    GeneratorConfig,
    LossConfig,
    OptimiserConfig,
    Stage,
    TranslatorConfig,
    TranslatorTrainingConfig,
)

_SLAM2CAD = TranslatorTrainingConfig(
    preset="slam2cad",
    translator=TranslatorConfig(
        input_encoding="free_occupied",
        output_encoding="layers",
        derotate=True,
        generator=GeneratorConfig("residual", width=24, depth=4),
    ),
    # No discriminators: layers are regions, and what counts is their overlap and their borders.
    loss=LossConfig(adversarial=0.0, l1=0.0, overlap=1.0),
    augment=True,
    optimiser=OptimiserConfig(
        learning_rate=2e-3, beta1=0.9, warm_up=0.02, decay=0.6, average=0.99, clip_norm=1.0
    ),
    stages=(Stage(256, 40.0, 8),),
    register=True,
)
"""For pairs rendered at one scale with true faces (`--scaling fixed --metres-per-px 0.05 --size 640`)."""

# A quarter of the width and batches of 8 take two fifths of the time per image. The discriminators at full resolution
# cost most of a step: thin ones leave time for twice the steps.
_THIN = DiscriminatorConfig(width=32, patch_width=16)
_FAST = OptimiserConfig(learning_rate=5e-4, average=0.99)

TRANSLATOR_PRESETS: dict[str, TranslatorTrainingConfig] = {
    "model32": TranslatorTrainingConfig(translator=TranslatorConfig(output_size=32)),
    "modelprog": TranslatorTrainingConfig(
        preset="modelprog",
        translator=TranslatorConfig(direction="cad2slam"),
        stages=(
            Stage(32, 16.0, 64),
            Stage(64, 15.0, 32, 1.0, 16),
            Stage(128, 30.0, 16, 1.0, 8),
            Stage(256, 139.0, 4, 1.0, 2),
        ),
    ),
    "slam2cad": _SLAM2CAD,
    "model32-cpu": TranslatorTrainingConfig(
        preset="model32-cpu",
        translator=TranslatorConfig(
            input_size=128,
            output_size=32,
            input_encoding="free_occupied",
            output_encoding="grey",
            generator=GeneratorConfig("progressive", width=16),
        ),
        discriminator=_THIN,
        optimiser=_FAST,
        stages=(Stage(32, 40.0, 8),),
        register=True,
        minutes=30.0,
    ),
    "modelprog-cpu": TranslatorTrainingConfig(
        preset="modelprog-cpu",
        translator=TranslatorConfig(
            direction="cad2slam",
            input_size=128,
            output_size=64,
            input_encoding="grey",
            output_encoding="free_occupied",
            generator=GeneratorConfig("progressive", width=16),
        ),
        discriminator=_THIN,
        optimiser=replace(_FAST, decay=0.5),
        # A third stage, at 128 px, was tried in a quarter of an hour: too few steps, everything became wall.
        # A pair takes 2.6 times as long at 64 px as at 32, so this is half as many pairs.
        stages=(Stage(32, 10.0, 8), Stage(64, 13.0, 8, 2.6)),
        register=True,
        minutes=60.0,
    ),
}


_FINE_TUNING_RATE = 0.1
"""Share of a preset's learning rate that trained weights are trained on with: the full one unlearns more than a few
pairs teach."""
_PATIENCE = 5
"""Passes without a better wall F1 after which such a training stops."""


def fine_tuning(preset: TranslatorTrainingConfig) -> TranslatorTrainingConfig:
    """A preset for a training that starts with trained weights: a tenth of the rate, and stopping early."""
    rate = preset.optimiser.learning_rate * _FINE_TUNING_RATE
    to_cad = preset.translator.direction == "slam2cad"
    return replace(
        preset,
        optimiser=replace(preset.optimiser, learning_rate=rate),
        patience=_PATIENCE if to_cad else 0,
    )


def find_preset(name: str) -> TranslatorTrainingConfig:
    """Look up a preset.

    Raises:
        ConfigError: If there is none of this name; the error suggests the nearest.
    """
    if name not in TRANSLATOR_PRESETS:
        raise ConfigError(f"unknown preset {name!r}; {suggest(name, TRANSLATOR_PRESETS)}")
    return TRANSLATOR_PRESETS[name]
