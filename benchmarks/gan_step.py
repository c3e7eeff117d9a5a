"""Which way of computing a training step of the default translator is fastest on this machine.

CPU seconds per image of a whole step (augmentation left out) for folds of 2 x 2 and 4 x 4 pixels, both memory layouts
and, if asked for, compiled by torch; the options that they belong to are named. Ratios are to the first row.

    python benchmarks/gan_step.py [--steps 4] [--threads 1] [--compile]
"""

import argparse
import time

import numpy as np
import torch
from report import print_and_save

from slamgym.gan.config import Layout, TrainConfig
from slamgym.gan.device import choose_compute
from slamgym.gan.networks.layers import count_parameters
from slamgym.gan.presets import PRESETS
from slamgym.gan.training.learner import Learner
from slamgym.gan.training.sampler import Batch
from slamgym.gan.training.schedule import Moment

COLUMNS = ("preset", "options", "weights", "CPU s per image", "of the first row", "CPU s of the first step")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--steps", type=int, default=4, help="measured steps after one to warm up")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--compile", action="store_true", help="measure compiled networks, too")
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    rows: list[list] = []
    ways: list[tuple[Layout, bool]] = [("contiguous", False), ("channels_last", False)]
    if arguments.compile:
        ways.append(("auto", True))
    for name in ("slam2cad", "slam2cad-fold4"):
        rows += [measure(name, PRESETS[name], layout, compiled, arguments.steps) for layout, compiled in ways]
    first = rows[0][3]
    rows = [[*row[:4], round(row[3] / first, 3), row[4]] for row in rows]
    print_and_save("gan_step", "A training step of the default translator, batch 8, 256 px", rows, COLUMNS)


def measure(name: str, config: TrainConfig, layout: Layout, compiled: bool, steps: int) -> list:
    learner = Learner(config, choose_compute("cpu", "auto", layout))
    if compiled:
        learner.compile()
    batch = random_batch(config)
    moment = Moment(256, len(batch.cad), 1.0, 1.0)
    warm_up = timed(learner, batch, moment)
    seconds = min(timed(learner, batch, moment) for _ in range(steps)) / len(batch.cad)
    options = "--compile" if compiled else f"--layout {layout}"
    print(f"{name} {options}: {seconds:.4f} s", flush=True)
    return [name, options, count_parameters(learner.generator), round(seconds, 4), round(warm_up, 1)]


def random_batch(config: TrainConfig) -> Batch:
    rng = np.random.default_rng(0)
    shape = (config.stages[-1].batch, config.translator.input_size, config.translator.input_size)
    slam = rng.choice(np.array([0, 205, 254], np.uint8), shape)
    return Batch(np.where(slam == 254, slam, 0).astype(np.uint8), slam, None, None)


def timed(learner: Learner, batch: Batch, moment: Moment) -> float:
    began = time.process_time()
    learner.step(batch, moment)
    return time.process_time() - began


if __name__ == "__main__":
    main()
