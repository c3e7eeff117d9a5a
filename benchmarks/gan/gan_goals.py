"""Drawings against true plans, set by set: errors, walls, rooms and dimensions of every method in one table.

    slamgym dataset render edition2/test -o out/native --scaling fixed --metres-per-px 0.05 --size 640
    slamgym dataset render edition2/test -o out/fitted
    python benchmarks/gan/gan_goals.py --images native=out/native fitted=out/fitted --tb3 tb3_house --real maps

Explorations by different recipes are sets of their own. The TurtleBot3 house has people's maps and exact walls. Real
maps have no truth: what can be said of them is how much of the drawn floor was never seen. Every method is aligned on
its own, rigidly and (as in the paper) by a similarity.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from slamgym.core.errors import SlamgymError
from slamgym.core.types import UNKNOWN
from slamgym.dataset.generate.recipe import MIXTURE
from slamgym.gan.data import PairSet, load_pairs
from slamgym.gan.evaluation.evaluate import (
    CLEANED,
    RAW,
    THRESHOLD,
    TranslationMethod,
    baselines,
    evaluate_method,
    evenly_spaced,
    learned,
)
from slamgym.gan.evaluation.summary import dimensions_table, summarise_scores
from slamgym.gan.pair_files import image_side
from slamgym.gan.translation.translate import load_translator
from slamgym.interop import read_ros_map
from slamgym.metrics import unseen_share

sys.path.insert(0, str(Path(__file__).parents[1]))
from realism.same_building import known_part, people_of_the_house
from report import print_and_save

MODULES = ("gan/translation", "slamgym/metrics")
"""What is measured."""


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--images", nargs="*", default=[], help="NAME=FOLDER of images with true faces"
    )
    parser.add_argument(
        "--tb3", type=Path, help="folder of the TurtleBot3 house: cad.json, cad_walls.png, runs/"
    )
    parser.add_argument("--real", type=Path, help="folder of ROS maps of real robots")
    parser.add_argument("--weights", nargs="*", default=["slam2cad"], help="NAME or NAME=PATH")
    parser.add_argument("--split", default="test")
    parser.add_argument(
        "--count", type=int, default=0, help="maps of each set, evenly spaced; 0 takes all"
    )
    arguments = parser.parse_args()
    used = methods(arguments.weights)
    sets: dict[str, PairSet] = {}
    for named in arguments.images:
        name, _, folder = named.partition("=")
        sets |= by_recipe(name, Path(folder), arguments.split)
    if arguments.tb3 is not None:
        sets["TB3 house"] = people_of_the_house(arguments.tb3)
    rows: list[Sequence[Any]] = []
    columns: list[str] = []
    for name, pairs in sets.items():
        if arguments.count:
            pairs = pairs.subset(evenly_spaced(len(pairs), arguments.count))
        columns, found = table(name, pairs, used)
        rows += found
    if rows:
        print_and_save(
            "gan/gan_goals",
            "Drawings against true plans; rigid alignment but where said",
            rows,
            columns,
            MODULES,
        )
    if arguments.real is not None:
        real = [row for method in used for row in never_seen(arguments.real, method)]
        title = "Real robots' maps: share of the drawn floor that was never seen"
        print_and_save(
            "gan/gan_goals_real", title, real, ("method", "maps", "median", "largest"), MODULES
        )


def methods(weights: Sequence[str]) -> list[TranslationMethod]:
    """Methods that are compared."""
    used = [method for method in baselines() if method.name in (RAW, CLEANED)]
    for argument in weights:
        name, _, path = argument.partition("=")
        used.append(learned(name, load_translator(path or name)))
    return used


def by_recipe(name: str, folder: Path, split: str) -> dict[str, PairSet]:
    """The pairs of a folder, each recipe apart; all together where none is recorded."""
    pairs = load_pairs(folder, split, image_side(folder, split))
    records = (json.loads(line) for line in (folder / "manifest.jsonl").read_text().splitlines())
    recipes = {record["name"]: record["conditions"].get(MIXTURE, "all") for record in records}
    drawn = [recipes[each] for each in pairs.names]
    return {
        f"{name}, {recipe}": pairs.subset([i for i, own in enumerate(drawn) if own == recipe])
        for recipe in sorted(set(drawn))
    }


def table(
    name: str, pairs: PairSet, used: Sequence[TranslationMethod]
) -> tuple[list[str], list[Sequence[Any]]]:
    """Columns and rows of one set."""
    summary = summarise_scores({method.name: evaluate_method(method, pairs) for method in used})
    headings, rows = dimensions_table(summary)
    similar = {
        method: "1" if method == RAW else f"{entry['improvement']['ratio_of_means']['value']:.2f}"
        for method, entry in summary.items()
    }
    columns = ["set", "maps", headings[0], "MSE ratio, similarity", *headings[1:]]
    return columns, [[name, len(pairs), row[0], similar[row[0]], *row[1:]] for row in rows]


def never_seen(folder: Path, method: TranslationMethod) -> list[Sequence[Any]]:
    """Median and largest share over real robots' maps."""
    shares = []
    for path in sorted(folder.rglob("*.yaml")):
        try:
            grid = read_ros_map(path)
        except SlamgymError:
            continue
        cells = known_part(grid.cells) if (grid.cells != UNKNOWN).any() else grid.cells
        scale = np.array([grid.frame.resolution])
        pair = PairSet(cells[np.newaxis], cells[np.newaxis], (path.stem,), (path.stem,), scale)
        shares.append(unseen_share(method.predict(pair, 0) >= THRESHOLD, cells != UNKNOWN))
    return (
        [(method.name, len(shares), round(float(np.median(shares)), 3), round(max(shares), 3))]
        if shares
        else []
    )


if __name__ == "__main__":
    main()
