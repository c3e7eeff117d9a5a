"""What the mean squared error of a perfect answer would be at a coarse resolution, and of answers that game it.

The CAD map itself is reduced to the resolution of a network's output, brought back (interpolated, or binary pixel by
pixel), and measured like any translation. Walls of both maps are also thickened, to see how much that decides.

Run: ``python benchmarks/gan_error_floor.py IMAGES [--count 150]``.
"""

import argparse
import os
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy starts its threads

import cv2
import numpy as np
from report import print_and_save

from slamgym.core.intervals import mean_interval
from slamgym.core.types import FREE, BoolArray, ByteArray, FloatArray
from slamgym.gan.data import PairSet, load_pairs
from slamgym.gan.encoding import enlarge_means
from slamgym.gan.evaluation.evaluate import evenly_spaced, score_map
from slamgym.gan.translation.classical import outline_only

SIZES = (16, 32, 64, 128)
WAYS_BACK = ("interpolated", "with its means kept", "binary")

Answer = Callable[[PairSet, int], BoolArray]


def coarse(size: int, way_back: str) -> Answer:
    """The CAD map as a network with an output of this size could give it at best, brought back to its own size."""

    def answer(pairs: PairSet, i: int) -> BoolArray:
        cad = (pairs.cad[i] > 127).astype(np.float32)
        small = cv2.resize(cad, (size, size), interpolation=cv2.INTER_AREA)
        if way_back == "with its means kept":
            return enlarge_means(small, (cad.shape[0], cad.shape[1])) >= 0.5
        if way_back == "binary":
            small = (small >= 0.5).astype(np.float32)
        method = cv2.INTER_NEAREST if way_back == "binary" else cv2.INTER_CUBIC
        large: BoolArray = cv2.resize(small, cad.shape[::-1], interpolation=method) >= 0.5
        return large

    return answer


def thickened(free: BoolArray, px: int) -> BoolArray:
    """Free space with walls thicker by ``px`` on each face."""
    thinner: BoolArray = cv2.erode(free.astype(np.uint8), np.ones((2 * px + 1,) * 2, np.uint8)) > 0
    return thinner


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("images", type=Path, help="folder that `slamgym dataset render` has written")
    parser.add_argument("--count", type=int, default=100)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    pairs = load_pairs(arguments.images, "test", 256)
    pairs = pairs.subset(evenly_spaced(len(pairs), arguments.count))
    answers: dict[str, tuple[Answer, int]] = {"raw SLAM map (MSE2)": (lambda p, i: p.slam[i] == FREE, 0)}
    for size in SIZES:
        for way_back in WAYS_BACK:
            answers[f"CAD map at {size} x {size}, {way_back}"] = (coarse(size, way_back), 0)
    answers["CAD map without its inner walls"] = (
        lambda p, i: outline_only(p.cad[i], p.scale(i)),
        0,
    )
    answers["raw SLAM map, walls of both thicker by 1 px"] = (
        lambda p, i: thickened(p.slam[i] == FREE, 1),
        1,
    )
    rows: list[tuple[object, ...]] = []
    raw: FloatArray | None = None
    for name, (answer, thicker) in answers.items():
        scores = [_score(answer(pairs, i), pairs, i, thicker) for i in range(len(pairs))]
        errors = np.array([s[0] for s in scores])
        raw = errors if raw is None else raw
        mse = mean_interval(errors, groups=list(pairs.plan_ids))
        f1 = mean_interval(np.array([s[1] for s in scores]), groups=list(pairs.plan_ids))
        rows.append(
            (
                name,
                round(mse.value, 5),
                f"[{mse.low:.5f}, {mse.high:.5f}]",
                round(float(errors.mean() / raw.mean()), 3),
                round(float(np.mean(errors < raw)), 2),
                f"{f1.value:.2f} [{f1.low:.2f}, {f1.high:.2f}]",
                round(float(np.mean([s[2] for s in scores])), 2),
            )
        )
    title = f"Aligned MSE of perfect answers and of answers that game it, {len(pairs)} test maps at 256 px"
    columns = (
        "answer",
        "MSE",
        "95 % interval",
        "share of MSE2",
        "maps improved",
        "wall F1 10 cm",
        "room count error",
    )
    print_and_save("gan_error_floor", title, rows, columns)


def _score(free: BoolArray, pairs: PairSet, i: int, thicker: int) -> tuple[float, float, int]:
    cad: ByteArray = pairs.cad[i]
    if thicker:
        cad = np.where(thickened(cad > 127, thicker), FREE, 0).astype(np.uint8)
    score = score_map(free, cad, pairs.scale(i))
    return score.mse, score["wall_f1_10cm"], score["room_error"]


if __name__ == "__main__":
    main()
