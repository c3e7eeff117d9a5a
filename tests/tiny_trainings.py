"""Trainings of translators that take a second."""

import dataclasses

from slamgym.gan.config import (
    DiscriminatorConfig,
    GeneratorConfig,
    LossConfig,
    OptimiserConfig,
    Stage,
    TranslatorConfig,
    TranslatorTrainingConfig,
)
from slamgym.gan.device import choose_compute
from slamgym.gan.training.train import RunOptions

CPU = choose_compute("cpu", "float32")
PROGRESSIVE = TranslatorTrainingConfig(
    preset="tiny",
    translator=TranslatorConfig(
        direction="slam2cad",
        input_size=32,
        output_size=32,
        input_encoding="grey",
        output_encoding="grey",
        generator=GeneratorConfig(width=2),
    ),
    discriminator=DiscriminatorConfig(width=8, patch_width=8),
    augment=True,
    optimiser=OptimiserConfig(average=0.9),
    stages=(Stage(16, 1.0, 2), Stage(32, 2.0, 2, 1.0, 1)),
    register=True,
)
RESIDUAL = dataclasses.replace(
    PROGRESSIVE,
    translator=dataclasses.replace(
        PROGRESSIVE.translator,
        derotate=True,
        input_encoding="free_occupied",
        output_encoding="layers",
        generator=GeneratorConfig("residual", width=8, depth=2),
    ),
    loss=LossConfig(adversarial=0.0, l1=0.0, overlap=1.0),
    optimiser=OptimiserConfig(learning_rate=5e-3, average=0.8, clip_norm=1.0),
    stages=(Stage(32, 2.0, 2),),
    register=False,
)
QUIET = RunOptions(checkpoint_minutes=60.0)
