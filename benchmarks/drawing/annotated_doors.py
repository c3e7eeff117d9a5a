"""Train the network to see doors as people see them in maps of real robots: once without each fold of buildings.

    slamgym dataset render DATASET -o out/images --scaling fixed --metres-per-px 0.05 --size 640
    python benchmarks/drawing/annotated_doors.py real_rooms out/images -o out/networks
    python benchmarks/drawing/boundaries.py real_rooms --networks out/networks -o out/rooms

The folder holds annotated maps, ``*/*/rooms.json`` and ``map.yaml``. Nobody knows their true walls, so floor and walls
are learned as the network drew them before, doors as the annotation has them; where people may differ, doors stay as
drawn before. Simulated pairs beside them keep what the network knows. ``fold0.safetensors`` to ``fold4.safetensors``
judge: each has never seen its fold. ``all.safetensors`` learned from all maps whose licence allows it, to be shipped.
Networks that are there already are kept.
"""

import argparse
import math
import sys
import time
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from slamgym.core.progress import say
from slamgym.core.types import FREE, UNKNOWN, BoolArray, ByteArray, FloatArray, GridFrame, IntArray
from slamgym.drawing.vectorise import known_part
from slamgym.gan.config import TranslatorTrainingConfig
from slamgym.gan.data import PairSet, load_pairs
from slamgym.gan.device import choose_compute, keep_freed_memory, make_deterministic
from slamgym.gan.encoding import resample_probability
from slamgym.gan.presets import TRANSLATOR_PRESETS
from slamgym.gan.training.learner import Learner
from slamgym.gan.training.sampler import BatchSampler
from slamgym.gan.training.schedule import Schedule, Span
from slamgym.gan.translation.tiling import tile_starts
from slamgym.gan.translation.translate import LearnedTranslator, load_translator
from slamgym.gan.weights import ModelCard, load_weights, save_translator
from slamgym.metrics.layers import DOOR_DEPTH
from slamgym.metrics.maps import resample_slam
from slamgym.metrics.wall_direction import (
    MIN_TURN_DEG,
    find_wall_direction,
    padded_for_turning,
    turned,
    turned_probability,
)

sys.path.insert(0, str(Path(__file__).parents[1]))
from annotated import AnnotatedMap, building_folds, read_annotated

SCALE = 0.05
"""The network's [m/px]."""
SIDE = 512
"""Maps are cut into squares of so many pixels, of which windows are drawn."""
LEAST_KNOWN = 4000
"""Squares that show fewer pixels are left out."""
SIMULATED = 0.4
"""Share of the squares that are simulated pairs."""
BATCH = 8
LEARNING_RATE = 5e-4
"""A quarter of the preset's: the network is trained already."""
BESIDE_OPTIONAL = 0.3
"""So far from a boundary that may be drawn or not doors stay as they were drawn [m]."""


class Annotated(NamedTuple):
    """A map, or a square of one, at the network's scale, its main walls along the axes."""

    cad: ByteArray
    """Floor, in shades where the network wasn't sure."""
    slam: ByteArray
    doors: BoolArray


@dataclass(frozen=True)
class Squares:
    """What is learned from: equal squares of maps."""

    cad: list[ByteArray]
    """Floor, (SIDE, SIDE)."""
    slam: list[ByteArray]
    doors: dict[int, IntArray]
    """Their pixels, flat, by the number of the square; those of simulated pairs are found."""

    def pairs(self) -> PairSet:
        """As a training takes them."""
        names = tuple(str(number) for number in range(len(self.cad)))
        scales = np.full(len(names), SCALE)
        return PairSet(np.stack(self.cad), np.stack(self.slam), names, names, scales)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("rooms", type=Path, help="folder of annotated maps")
    parser.add_argument("simulated", type=Path, help="folder of simulated pairs")
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder for the networks")
    parser.add_argument("--start-from", default="slam2cad", help="weights to start with")
    parser.add_argument("--steps", type=int, default=400)
    parser.add_argument("--folds", nargs="*", type=int, help="numbers; all, and the one to ship")
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    keep_freed_memory()
    make_deterministic()
    maps = read_annotated(arguments.rooms)
    translator = load_translator(arguments.start_from, "slam2cad")
    simulated = load_pairs(arguments.simulated, "train", 640).windows(SIDE)
    left_out: dict[str, Collection[int]] = {
        f"fold{number}": left for number, (_, left) in enumerate(building_folds(maps))
    }
    left_out["all"] = ()
    wanted = arguments.folds
    names = list(left_out) if wanted is None else [list(left_out)[number] for number in wanted]
    for name in names:
        path = arguments.output / f"{name}.safetensors"
        if path.exists():
            continue
        used = [one for i, one in enumerate(maps) if one.may_be_used and i not in left_out[name]]
        say(f"{name}: {len(used)} maps")
        squares = squares_of(used, translator, simulated)
        train(squares, arguments.start_from, arguments.steps, path)


def squares_of(
    maps: Sequence[AnnotatedMap], translator: LearnedTranslator, simulated: PairSet
) -> Squares:
    """Squares of annotated maps, and of simulated pairs, each as often as their share says."""
    squares = Squares([], [], {})
    for one in maps:
        for square in cut(annotated_pair(one, translator)):
            squares.doors[len(squares.cad)] = np.flatnonzero(square.doors)
            squares.cad.append(square.cad)
            squares.slam.append(square.slam)
    count = round(len(squares.cad) * SIMULATED / (1.0 - SIMULATED))
    rng = np.random.default_rng(0)
    rounds = math.ceil(count / len(simulated))
    order = np.concatenate([rng.permutation(len(simulated)) for _ in range(rounds)])
    for index in order[:count].tolist():
        squares.cad.append(simulated.cad[index])
        squares.slam.append(simulated.slam[index])
    return squares


def annotated_pair(one: AnnotatedMap, translator: LearnedTranslator) -> Annotated:
    """What is learned of an annotated map."""
    grid = known_part(one.grid)
    angle = find_wall_direction(grid.cells).angle_deg
    if abs(angle) < MIN_TURN_DEG:
        angle = 0.0
    factor = grid.frame.resolution / SCALE
    certain, optional = one.boundaries()

    def straight(strips: ByteArray) -> BoolArray:
        padded = padded_for_turning(strips, angle, 0)
        picture = turned_probability(padded.astype(np.float32), -angle)
        return resample_probability(picture, slam.shape) > 0.5

    cells = turned(padded_for_turning(grid.cells, angle), -angle)
    rows, cols = (math.ceil(side * factor) for side in cells.shape)
    slam = resample_slam(cells, (rows, cols))
    layers = translator.layers(slam, SCALE, 0.0)
    doors = straight(strips_along(certain, grid.frame, DOOR_DEPTH + 0.5 * SCALE))
    floor = np.where(doors & (slam == FREE), 1.0, layers.free)
    doubtful = straight(strips_along(optional, grid.frame, BESIDE_OPTIONAL))
    doors |= doubtful & (layers.door > 0.5)
    cad = np.round(FREE * np.clip(floor, 0.0, 1.0)).astype(np.uint8)
    return Annotated(cad, slam, doors)


def strips_along(lines: FloatArray, frame: GridFrame, half_width: float) -> ByteArray:
    """A picture of strips about lines (N, 2, 2) [m]: 1 in them, 0 elsewhere."""
    picture = np.zeros(frame.shape, np.uint8)
    for start, end in lines:
        along = (end - start) / max(float(np.hypot(*(end - start))), 1e-9)
        aside = half_width * np.array([-along[1], along[0]])
        corners = np.array([start + aside, end + aside, end - aside, start - aside])
        x = (corners[:, 0] - frame.origin_x) / frame.resolution - 0.5
        y = (corners[:, 1] - frame.origin_y) / frame.resolution
        pixels = np.column_stack([x, frame.height_px - 0.5 - y])
        cv2.fillConvexPoly(picture, np.round(16.0 * pixels).astype(np.int32), 1, shift=4)
    return picture


def cut(whole: Annotated) -> Iterator[Annotated]:
    """Squares that cover a map and show enough of it."""
    rows, cols = (max(0, SIDE - side) for side in whole.slam.shape)
    border = ((rows // 2, rows - rows // 2), (cols // 2, cols - cols // 2))
    cad = np.pad(whole.cad, border)
    slam = np.pad(whole.slam, border, constant_values=UNKNOWN)
    doors = np.pad(whole.doors, border)
    for top in tile_starts(slam.shape[0], SIDE):
        for left in tile_starts(slam.shape[1], SIDE):
            place = slice(top, top + SIDE), slice(left, left + SIDE)
            if np.count_nonzero(slam[place] != UNKNOWN) >= LEAST_KNOWN:
                yield Annotated(cad[place], slam[place], doors[place])


def train(squares: Squares, start_from: str, steps: int, path: Path) -> None:
    """Go on with trained weights, and write what comes of it."""
    config = training_config(start_from)
    compute = choose_compute("cpu", "float32")  # on one core quicker than bfloat16
    learner = Learner(config, compute)
    learner.adopt(load_weights(start_from, "slam2cad").generator)
    pairs = squares.pairs()
    sampler = BatchSampler(pairs, config, np.random.default_rng(config.seed), squares.doors)
    settings = config.optimiser
    span = Span(config.translator.output_size, BATCH, steps, fading=False)
    schedule = Schedule((span,), settings.warm_up, settings.decay)
    begun = time.monotonic()
    for step in range(steps):
        terms = learner.step(sampler.draw(BATCH), schedule.moment(step * BATCH))
        if (step + 1) % 50 == 0:
            say(f"step {step + 1}: {terms['total']:.3f}, {time.monotonic() - begun:.0f} s")
    card = ModelCard(
        preset=config.preset,
        pairs=len(pairs),
        images=learner.images_done,
        seconds=round(time.monotonic() - begun, 1),
        seed=config.seed,
        command="python benchmarks/drawing/annotated_doors.py real_rooms out/images -o out/networks",
        data=f"squares of annotated maps, {len(squares.doors)}, and of simulated pairs, "
        f"{len(pairs) - len(squares.doors)}; from the weights of edition 2",
        device=f"{compute.device.type}, {compute.precision}",
    )
    save_translator(path, learner.best_generator, config.translator, card)


def training_config(start_from: str) -> TranslatorTrainingConfig:
    """The preset's, from trained weights."""
    preset = TRANSLATOR_PRESETS["slam2cad"]
    return replace(
        preset,
        translator=load_weights(start_from, "slam2cad").config,
        optimiser=replace(preset.optimiser, learning_rate=LEARNING_RATE),
        register=False,
        start_from=start_from,
    )


if __name__ == "__main__":
    main()
