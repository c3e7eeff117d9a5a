"""What training the translators costs: GFLOP and CPU seconds per image, beside the published code's.

One thread, batch 4, a whole step (generator, both discriminators, three optimisers, augmentation left out). The
published code (anime2clothing, which the paper uses) took 0.616, 1.75, 5.72 and 18.9 CPU seconds per image at
32, 64, 128 and 256 px on a machine of the same kind; FLOPs don't depend on the machine. ``identical`` is the
same graph in single precision with unneeded gradients left out, ``halved`` has the patch discriminators' channels
halved, ``bfloat16`` mixes precisions.

    python benchmarks/gan_cost.py [--resolutions 32 64] [--steps 2]
"""

import argparse
import dataclasses
import time

import numpy as np
import torch
from report import print_and_save
from torch.utils.flop_counter import FlopCounterMode

from slamgym.gan.config import DiscriminatorConfig, TranslatorTrainingConfig
from slamgym.gan.device import Compute
from slamgym.gan.presets import TRANSLATOR_PRESETS
from slamgym.gan.training.learner import Learner
from slamgym.gan.training.sampler import Batch
from slamgym.gan.training.schedule import Moment
from slamgym.gan.translation.translate import LearnedTranslator
from slamgym.gan.weights import ModelCard

PUBLISHED_SECONDS = {32: 0.616, 64: 1.75, 128: 5.72, 256: 18.9}
PUBLISHED_GFLOP = {32: 40.7, 64: 142.7, 128: 397.0, 256: 1159.0}
COLUMNS = (
    "setting", "side px", "batch", "precision", "GFLOP per image", "of the published", "CPU s per image",
    "of the published code's",
)  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--resolutions", type=int, nargs="+", default=[32, 64, 128, 256])
    parser.add_argument("--steps", type=int, default=2, help="measured steps after one to warm up")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    paper = TRANSLATOR_PRESETS["modelprog"]
    halved = dataclasses.replace(paper, discriminator=DiscriminatorConfig(patch_width=64))
    rows = []
    for side in arguments.resolutions:
        rows.append(measure("identical", paper, side, 4, "float32", arguments.steps))
        rows.append(measure("halved patch discriminators", halved, side, 4, "float32", arguments.steps))
        rows.append(measure("halved, bfloat16", halved, side, 4, "bfloat16", arguments.steps))
    rows.append(
        measure("slam2cad (default)", TRANSLATOR_PRESETS["slam2cad"], 256, 8, "float32", arguments.steps)
    )
    rows.append(
        measure("slam2cad (default)", TRANSLATOR_PRESETS["slam2cad"], 256, 8, "bfloat16", arguments.steps)
    )
    rows.append(inference())
    print_and_save("gan_cost", "Cost of one image (training step; last row: a translation)", rows, COLUMNS)


def measure(
    name: str, config: TranslatorTrainingConfig, side: int, batch_size: int, precision: str, steps: int
) -> list:
    compute = Compute(torch.device("cpu"), precision)  # type: ignore[arg-type]
    learner = Learner(config, compute)
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
    learner = Learner(TRANSLATOR_PRESETS["slam2cad"], Compute(torch.device("cpu"), "float32"))
    translator = LearnedTranslator(learner.generator.eval(), config, ModelCard(), learner.compute)
    slam = random_batch(1, 256).slam[0]
    with FlopCounterMode(display=False) as counter:
        translator.translate(slam)
    seconds = min(timed(lambda: translator.translate(slam)) for _ in range(5))
    return ["slam2cad: translate", 256, 1, "float32", counter.get_total_flops() / 1e9, None, seconds, None]


def random_batch(count: int, side: int) -> Batch:
    rng = np.random.default_rng(0)
    maps = [rng.choice(np.array([0, 205, 254], np.uint8), (count, side, side)) for _ in range(4)]
    return Batch(*maps)


def timed(run) -> float:  # noqa: ANN001
    began = time.process_time()
    run()
    return time.process_time() - began


if __name__ == "__main__":
    main()
