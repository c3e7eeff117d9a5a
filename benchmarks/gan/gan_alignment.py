"""Accuracy and time of the alignment that the evaluation of the translators uses.

Free-space masks of SLAM maps are moved by random similarities and aligned with their CAD maps by the search that
`slamgym gan evaluate` uses, by OpenCV's ECC, and by feature matching. The reference is the best error that any of them
or a search from 72 rotations, 24 of them refined, finds for the pair.

``--floor`` measures instead the aligned error of a perfect answer at a coarse resolution, and of answers that game it:
the CAD map itself is reduced to the resolution of a network's output, brought back (interpolated, or binary pixel by
pixel), and measured like any translation. Walls of both maps are also thickened, to see how much that decides.

    python benchmarks/gan/gan_alignment.py IMAGES [--pairs 24] [--moves 4]
    python benchmarks/gan/gan_alignment.py IMAGES --floor [--count 150]
"""

import argparse
import math
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy starts its threads

import cv2
import numpy as np

from slamgym.core.intervals import mean_interval
from slamgym.core.types import FREE, BoolArray, ByteArray, FloatArray
from slamgym.gan.data import PairSet, load_pairs
from slamgym.gan.encoding import enlarge_means
from slamgym.gan.evaluation.evaluate import evenly_spaced, score_map
from slamgym.gan.translation.classical import outline_only
from slamgym.metrics import Similarity, aligned_error, apply_similarity, squared_error
from slamgym.metrics.alignment import search_similarities

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

MODULES = ("slamgym/metrics/alignment.py",)
"""What is measured."""

SIZE = 128
NEAR = 0.005  # of the best mean squared error
MAX_TURN, MAX_LOG_SCALE, MAX_SHIFT = math.radians(30.0), 0.1, 0.06

COARSE_SIZES = (16, 32, 64, 128)
ENLARGEMENTS = ("interpolated", "with its means kept", "binary")

Align = Callable[[FloatArray, FloatArray], float]
Answer = Callable[[PairSet, int], BoolArray]


def search(image: FloatArray, target: FloatArray) -> float:
    return aligned_error(image, target).mse


def exhaustive(image: FloatArray, target: FloatArray) -> float:
    found = search_similarities(image, target, start_angles=72, coarse_starts=24, fine_starts=8)
    return min(squared_error(apply_similarity(image, s), target) for s in found)


def ecc(motion: int) -> Align:
    """Enhanced correlation coefficient (Evangelidis and Psarakis 2008) on images blurred by 8, 4 and 2 px."""

    def align(image: FloatArray, target: FloatArray) -> float:
        warp = np.eye(2, 3, dtype=np.float32)
        for sigma in (8.0, 4.0, 2.0):
            a, b = (cv2.GaussianBlur(i.astype(np.float32), (0, 0), sigma) for i in (image, target))
            try:
                stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 60, 1e-5)
                _, warp = cv2.findTransformECC(b, a, warp, motion, stop, None, 5)
            except cv2.error:
                break  # it has run out of overlap
        moved = cv2.warpAffine(
            image.astype(np.float32),
            warp,
            image.shape[::-1],
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        )
        return min(squared_error(image, target), squared_error(moved.astype(np.float64), target))

    return align


def features(make: Callable[[], cv2.Feature2D], norm: int) -> Align:
    """Keypoints matched with the ratio test, and a similarity by RANSAC."""

    def align(image: FloatArray, target: FloatArray) -> float:
        unaligned = squared_error(image, target)
        detector = make()
        found = [
            detector.detectAndCompute((i * 255).astype(np.uint8), None) for i in (image, target)
        ]
        if any(descriptors is None or len(descriptors) < 3 for _, descriptors in found):
            return unaligned
        matches = cv2.BFMatcher(norm).knnMatch(found[0][1], found[1][1], k=2)
        good = [m for m, *rest in matches if rest and m.distance < 0.85 * rest[0].distance]
        if len(good) < 3:
            return unaligned
        a = np.array([found[0][0][m.queryIdx].pt for m in good], np.float32)
        b = np.array([found[1][0][m.trainIdx].pt for m in good], np.float32)
        warp, _ = cv2.estimateAffinePartial2D(a, b, method=cv2.RANSAC, ransacReprojThreshold=4.0)
        if warp is None:
            return unaligned
        moved = cv2.warpAffine(
            image.astype(np.float32), warp, image.shape[::-1], flags=cv2.INTER_LINEAR
        )
        return min(unaligned, squared_error(moved.astype(np.float64), target))

    return align


def methods() -> dict[str, Align]:
    return {
        "multi-start Powell, coarse to fine (ours)": search,
        "ECC, euclidean": ecc(cv2.MOTION_EUCLIDEAN),
        "ECC, affine (not a similarity: shear absorbs drift)": ecc(cv2.MOTION_AFFINE),
        "SIFT + RANSAC": features(cv2.SIFT.create, cv2.NORM_L2),
        "ORB + RANSAC": features(cv2.ORB.create, cv2.NORM_HAMMING),
    }


def moved_pairs(images: Path, pairs: int, moves: int) -> list[list[tuple[FloatArray, FloatArray]]]:
    """For each pair, the map under several random similarities, and the CAD map."""
    loaded = load_pairs(images, "test", SIZE)
    rng = np.random.default_rng(0)
    result = []
    for i in evenly_spaced(len(loaded), pairs):
        target = (loaded.cad[i] > 127).astype(np.float64)
        image = (loaded.slam[i] == FREE).astype(np.float64)
        drawn = rng.uniform(-1.0, 1.0, (moves, 4)) * (MAX_SHIFT, MAX_SHIFT, MAX_TURN, MAX_LOG_SCALE)
        result.append(
            [
                ((apply_similarity(image, Similarity(*d)) >= 0.5).astype(np.float64), target)
                for d in drawn
            ]
        )
    return result


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "images", type=Path, help="folder that `slamgym dataset render` has written"
    )
    parser.add_argument("--pairs", type=int, default=24)
    parser.add_argument("--moves", type=int, default=4)
    parser.add_argument("--floor", action="store_true", help="measure perfect answers instead")
    parser.add_argument("--count", type=int, default=100, help="test maps of --floor")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    if arguments.floor:
        measure_floor(arguments.images, arguments.count)
    else:
        compare_methods(arguments.images, arguments.pairs, arguments.moves)


def compare_methods(images: Path, pairs: int, moves: int) -> None:
    cv2.setRNGSeed(0)
    moved = moved_pairs(images, pairs, moves)
    search(*moved[0][0])  # compiles the kernel
    errors, milliseconds = {}, {}
    for name, align in methods().items():
        begun = time.process_time()
        errors[name] = np.array([[align(*pair) for pair in row] for row in moved])
        milliseconds[name] = 1e3 * (time.process_time() - begun) / errors[name].size
    reference = np.array([[exhaustive(*pair) for pair in row] for row in moved])
    best = np.minimum(
        reference, np.min([e for n, e in errors.items() if "affine" not in n], axis=0)
    )
    rows: list[tuple[str, float, float, float, float | None]] = [
        (
            "no alignment",
            *_row(np.array([[squared_error(*p) for p in r] for r in moved]), best),
            0.0,
        )
    ]
    rows += [
        (name, *_row(error, best), round(milliseconds[name], 1)) for name, error in errors.items()
    ]
    rows.append(("the best of all similarities", *_row(best, best), None))
    print_and_save(
        "gan/gan_alignment",
        f"Aligning {len(moved)} SLAM maps under {moves} random similarities each, {SIZE} px "
        "(turn up to 30 degrees, scale 0.9 to 1.1, shift up to 6 %)",
        rows,
        (
            "method",
            "mean MSE",
            f"share within {NEAR} of the best",
            "spread over start poses",
            "CPU ms a pair",
        ),
        MODULES,
        times=("CPU ms a pair",),
    )


def _row(errors: np.ndarray, best: np.ndarray) -> tuple[float, float, float]:
    # The same map from other poses should give the same error, but for the resampling of the pose itself.
    spread = float(errors.std(axis=1).mean())
    return (
        round(float(errors.mean()), 4),
        round(float((errors <= best + NEAR).mean()), 3),
        round(spread, 4),
    )


def coarse(size: int, enlargement: str) -> Answer:
    """The CAD map as a network with an output of this size could give it at best, brought back to its own size."""

    def answer(pairs: PairSet, i: int) -> BoolArray:
        cad = (pairs.cad[i] > 127).astype(np.float32)
        small = cv2.resize(cad, (size, size), interpolation=cv2.INTER_AREA)
        if enlargement == "with its means kept":
            return enlarge_means(small, (cad.shape[0], cad.shape[1])) >= 0.5
        if enlargement == "binary":
            small = (small >= 0.5).astype(np.float32)
        method = cv2.INTER_NEAREST if enlargement == "binary" else cv2.INTER_CUBIC
        large: BoolArray = cv2.resize(small, cad.shape[::-1], interpolation=method) >= 0.5
        return large

    return answer


def thickened(free: BoolArray, px: int) -> BoolArray:
    """Free space with walls thicker by ``px`` on each face."""
    thinner: BoolArray = cv2.erode(free.astype(np.uint8), np.ones((2 * px + 1,) * 2, np.uint8)) > 0
    return thinner


def measure_floor(images: Path, count: int) -> None:
    pairs = load_pairs(images, "test", 256)
    pairs = pairs.subset(evenly_spaced(len(pairs), count))
    answers: dict[str, tuple[Answer, int]] = {
        "raw SLAM map (MSE2)": (lambda p, i: p.slam[i] == FREE, 0)
    }
    for size in COARSE_SIZES:
        for enlargement in ENLARGEMENTS:
            answers[f"CAD map at {size} x {size}, {enlargement}"] = (coarse(size, enlargement), 0)
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
        scores = [score_answer(answer(pairs, i), pairs, i, thicker) for i in range(len(pairs))]
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
    print_and_save("gan/gan_error_floor", title, rows, columns, MODULES)


def score_answer(
    free: BoolArray, pairs: PairSet, i: int, thicker: int
) -> tuple[float, float, float]:
    cad: ByteArray = pairs.cad[i]
    if thicker:
        cad = np.where(thickened(cad > 127, thicker), FREE, 0).astype(np.uint8)
    score = score_map(free, cad, pairs.scale(i))
    return score.mse, score["wall_f1_10cm"], score["room_error"]


if __name__ == "__main__":
    main()
