"""Value of each choice in the default translator: variants trained for equal time, measured on validation plans.

The validation plans are those that every training holds out; the test plans aren't looked at. Errors are aligned as in
``slamgym gan evaluate``. Finished trainings are kept, an interrupted one continues; the table ends with the
pretrained weights.

Run: ``python benchmarks/gan/gan_variants.py IMAGES -o OUT [--minutes 6]``. Trainings run one after the other, each on
one thread; run two with halves of ``--only`` side by side on two cores.
"""

import argparse
import os
import sys
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy and torch start their threads

import numpy as np

from slamgym.commands.cli import TABLE
from slamgym.gan.data import PairSet, load_pairs
from slamgym.gan.evaluation.evaluate import MapScore, baselines, evaluate_method, learned
from slamgym.gan.training.held_out import MAX_VALIDATION_PAIRS, VALIDATION_SHARE
from slamgym.gan.translation.translate import LearnedTranslator, load_translator
from slamgym.metrics import improvement

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

MODULES = ("gan/networks", "gan/training")
"""What is measured."""

VARIANTS: dict[str, tuple[str, tuple[str, ...]]] = {
    "slam2cad": ("slam2cad", ()),
    "pairs not registered": ("slam2cad", ("register=false",)),
}
"""Preset and settings by what the variant changes."""


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "images", type=Path, help="folder that `slamgym dataset render` has written"
    )
    parser.add_argument(
        "-o", "--out", type=Path, default=Path("out/variants"), help="folder of the trainings"
    )
    parser.add_argument("--minutes", type=float, default=6.0, help="of each training")
    parser.add_argument(
        "--only",
        type=int,
        nargs="*",
        help="numbers of the variants to train, from 0; no table then",
    )
    arguments = parser.parse_args()
    folders = {name: arguments.out / f"variant_{number}" for number, name in enumerate(VARIANTS)}
    for number, (name, folder) in enumerate(folders.items()):
        wanted = arguments.only is None or number in arguments.only
        if wanted and not (folder / "weights.safetensors").exists():
            train_variant(arguments.images, folder, name, arguments.minutes)
    if arguments.only is not None:
        return
    _, pairs = load_pairs(arguments.images, "train", 256).split(VALIDATION_SHARE)
    pairs = pairs.subset(range(min(len(pairs), MAX_VALIDATION_PAIRS)))
    raw = np.array([score.mse for score in evaluate_method(baselines()[0], pairs)])
    rows = [row(name, load_translator(folder), pairs, raw) for name, folder in folders.items()]
    rows.append(row("pretrained weights", load_translator("slam2cad"), pairs, raw))
    title = f"Variants of slam2cad, {arguments.minutes:g} minutes each; {len(pairs)} maps of validation plans"
    columns = (
        "variant", "images learnt from", "MSE1 / MSE2", "grey MSE1 / MSE2", "wall F1 10 cm", "room F1", "CPU ms a map",
    )  # fmt: skip
    print_and_save("gan/gan_variants", title, rows, columns, MODULES)


def train_variant(images: Path, run: Path, name: str, minutes: float) -> None:
    preset, settings = VARIANTS[name]
    arguments = [str(images), "-o", str(run), "--preset", preset, "--minutes", str(minutes)]
    TABLE.run("slamgym", ["gan", "train", *arguments, *(["--set", *settings] if settings else [])])


def row(
    name: str, translator: LearnedTranslator, pairs: PairSet, raw: np.ndarray
) -> tuple[object, ...]:
    """Figures of a translator, with intervals over plans for the error."""
    scores = evaluate_method(learned(name, translator), pairs)
    ratio = improvement(_column(scores, "mse"), raw, list(pairs.plan_ids)).ratio_of_means
    grey = improvement(_column(scores, "mse_grey"), raw, list(pairs.plan_ids)).ratio_of_means
    return (
        name,
        translator.card.images,
        f"{ratio.value:.3f} [{ratio.low:.3f}, {ratio.high:.3f}]",
        f"{grey.value:.3f} [{grey.low:.3f}, {grey.high:.3f}]",
        round(float(_column(scores, "wall_f1_10cm").mean()), 3),
        round(float(_column(scores, "room_f1").mean()), 3),
        round(1e3 * float(_column(scores, "seconds").mean())),
    )


def _column(scores: list[MapScore], name: str) -> np.ndarray:
    return np.array([score[name] for score in scores], dtype=np.float64)


if __name__ == "__main__":
    main()
