"""Cost of training the translators: GFLOP and CPU seconds per image, compared with the published code's.

One thread, batch 4, a whole step (generator, both discriminators, three optimisers, augmentation left out). The
published code (anime2clothing, which the paper uses) took 0.616, 1.75, 5.72 and 18.9 CPU seconds per image at
32, 64, 128 and 256 px on a machine of the same kind; FLOPs don't depend on the machine. ``identical`` is the
same graph in single precision with unneeded gradients left out, ``halved`` has the patch discriminators' channels
halved, ``bfloat16`` mixes precisions.

``--layouts`` measures instead which memory layout and, with ``--compile``, compiled
networks take a training step of the default translator fastest on this machine; ratios are to the first row.

    python benchmarks/gan/gan_cost.py [--resolutions 32 64] [--steps 2]
    python benchmarks/gan/gan_cost.py --layouts [--steps 4] [--threads 1]
"""

import argparse
import dataclasses
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from torch.utils.flop_counter import FlopCounterMode

from slamgym.gan.config import DiscriminatorConfig, TranslatorTrainingConfig
from slamgym.gan.device import choose_compute
from slamgym.gan.networks.factory import count_parameters, on_device
from slamgym.gan.presets import TRANSLATOR_PRESETS
from slamgym.gan.training.learner import Learner
from slamgym.gan.training.sampler import Batch
from slamgym.gan.training.schedule import Moment
from slamgym.gan.translation.translate import LearnedTranslator
from slamgym.gan.weights import ModelCard

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

MODULES = ("gan/networks", "gan/training")
"""What is measured."""

PUBLISHED_SECONDS = {32: 0.616, 64: 1.75, 128: 5.72, 256: 18.9}
PUBLISHED_GFLOP = {32: 40.7, 64: 142.7, 128: 397.0, 256: 1159.0}
COLUMNS = (
    "setting", "side px", "batch", "precision", "GFLOP per image", "of the published", "CPU s per image",
    "of the published code's",
)  # fmt: skip
LAYOUT_COLUMNS = (
    "preset", "options", "weights", "CPU s per image", "of the first row", "CPU s of the first step",
)  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--resolutions", type=int, nargs="+", default=[32, 64, 128, 256])
    parser.add_argument(
        "--steps", type=int, help="measured steps after one to warm up (2; 4 with --layouts)"
    )
    parser.add_argument("--layouts", action="store_true", help="compare layouts and folds instead")
    parser.add_argument("--threads", type=int, default=1, help="with --layouts")
    arguments = parser.parse_args()
    if arguments.layouts:
        torch.set_num_threads(arguments.threads)
        compare_layouts(arguments.steps or 4)
    else:
        torch.set_num_threads(1)
        compare_with_published(arguments.resolutions, arguments.steps or 2)


def compare_with_published(resolutions: list[int], steps: int) -> None:
    paper = TRANSLATOR_PRESETS["modelprog"]
    halved = dataclasses.replace(paper, discriminator=DiscriminatorConfig(patch_width=64))
    rows = []
    for side in resolutions:
        rows.append(measure("identical", paper, side, 4, "float32", steps))
        rows.append(measure("halved patch discriminators", halved, side, 4, "float32", steps))
        rows.append(measure("halved, bfloat16", halved, side, 4, "bfloat16", steps))
    rows.append(
        measure("slam2cad (default)", TRANSLATOR_PRESETS["slam2cad"], 256, 8, "float32", steps)
    )
    rows.append(
        measure("slam2cad (default)", TRANSLATOR_PRESETS["slam2cad"], 256, 8, "bfloat16", steps)
    )
    rows.append(inference())
    title = "Cost of one image (training step; last row: a translation)"
    print_and_save("gan/gan_cost", title, rows, COLUMNS, MODULES, times=("CPU s per image",))


def measure(
    name: str,
    config: TranslatorTrainingConfig,
    side: int,
    batch_size: int,
    precision: str,
    steps: int,
) -> list:
    learner = Learner(config, choose_compute("cpu", precision))  # type: ignore[arg-type]
    batch = random_batch(batch_size, config.translator.input_size)
    moment = Moment(side, batch_size, 1.0, 1.0)
    with FlopCounterMode(display=False) as counter:
        learner.step(batch, moment)
    seconds = min(timed(lambda: learner.step(batch, moment)) for _ in range(steps)) / batch_size
    gflop = counter.get_total_flops() / batch_size / 1e9
    print(f"{name} {side} px {precision}: {seconds:.3f} s", flush=True)
    return [
        name, side, batch_size, precision, gflop, gflop / PUBLISHED_GFLOP[side], seconds,
        seconds / PUBLISHED_SECONDS[side],
    ]  # fmt: skip


def inference() -> list:
    """One map of 256 px through the default translator, derotation and resampling included."""
    config = TRANSLATOR_PRESETS["slam2cad"].translator
    learner = Learner(TRANSLATOR_PRESETS["slam2cad"], choose_compute("cpu", "float32"))
    translator = LearnedTranslator(
        on_device(learner.generator.eval(), config, learner.compute), config, ModelCard()
    )
    slam = random_batch(1, 256).slam[0]
    with FlopCounterMode(display=False) as counter:
        translator.translate(slam)
    seconds = min(timed(lambda: translator.translate(slam)) for _ in range(5))
    return [
        "slam2cad: translate",
        256,
        1,
        "float32",
        counter.get_total_flops() / 1e9,
        None,
        seconds,
        None,
    ]


def random_batch(count: int, side: int) -> Batch:
    rng = np.random.default_rng(0)
    maps = [rng.choice(np.array([0, 205, 254], np.uint8), (count, side, side)) for _ in range(4)]
    return Batch(*maps)


def timed(run: Callable[[], object]) -> float:
    began = time.process_time()
    run()
    return time.process_time() - began


def compare_layouts(steps: int) -> None:
    """CPU seconds per image of a whole step, augmentation left out."""
    rows = [
        measure_layout("slam2cad", TRANSLATOR_PRESETS["slam2cad"], last, steps)
        for last in (False, True)
    ]
    first = rows[0][3]
    rows = [[*row[:4], round(row[3] / first, 3), row[4]] for row in rows]
    title = "A training step of the default translator, batch 8, 256 px"
    times = ("CPU s per image", "CPU s of the first step")
    print_and_save("gan/gan_step", title, rows, LAYOUT_COLUMNS, MODULES, times)


def measure_layout(
    name: str, config: TranslatorTrainingConfig, channels_last: bool, steps: int
) -> list:
    learner = Learner(
        config, dataclasses.replace(choose_compute("cpu"), channels_last=channels_last)
    )
    batch = paired_batch(config)
    moment = Moment(256, len(batch.cad), 1.0, 1.0)
    warm_up = timed(lambda: learner.step(batch, moment))
    seconds = min(timed(lambda: learner.step(batch, moment)) for _ in range(steps)) / len(batch.cad)
    options = f"layout {'channels_last' if channels_last else 'contiguous'}"
    print(f"{name} {options}: {seconds:.4f} s", flush=True)
    return [
        name,
        options,
        count_parameters(learner.generator),
        round(seconds, 4),
        round(warm_up, 1),
    ]


def paired_batch(config: TranslatorTrainingConfig) -> Batch:
    rng = np.random.default_rng(0)
    shape = (config.stages[-1].batch, config.translator.input_size, config.translator.input_size)
    slam = rng.choice(np.array([0, 205, 254], np.uint8), shape)
    return Batch(np.where(slam == 254, slam, 0).astype(np.uint8), slam, None, None)


if __name__ == "__main__":
    main()
