"""Can maps of `slamgym deform` be told from simulated ones, and do they differ as much from draw to draw?

For every pair of a dataset each method makes a map of the same plan: the parametric model and the generator along the
path that the robot truly drove, the latter with the robot and the furniture of that exploration. Trees on map
statistics learn to tell the kinds apart, held out by plan; 0.5 is perfect. Diversity is how many of the cells that
either map knows differ between two maps of one plan, as a share of what differs between the simulated ones.

    python benchmarks/parametric/deform_realism.py DATASET ... [--methods parametric generator modelprog elastic]

Each dataset was made by `slamgym generate`; its pairs are judged by recipe, which is the folder's name where a pair
doesn't say. ``--half 1`` leaves out the plans on which the generator's errors were fitted.
"""

import argparse
import hashlib
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy starts its threads

import numpy as np

from slamgym.agents.evaluation.report import with_bounds
from slamgym.cad import FloorPlan
from slamgym.commands.deforming.hypotheses import furnished, recorded_drive
from slamgym.core.pictures import read_png
from slamgym.core.types import FREE, UNKNOWN, ByteArray, GridFrame, OccupancyGrid, Trajectory
from slamgym.dataset.format import Layout, read_manifest
from slamgym.dataset.generate.recipe import MIXTURE, apply_conditions
from slamgym.dataset.images.square_images import resample_map
from slamgym.dataset.record import PairRecord
from slamgym.envs.episode import EpisodeConfig
from slamgym.gan.translation.elastic import bend_with_field
from slamgym.gan.translation.translate import load_translator
from slamgym.metrics.map_statistics import at_look_cell, cut_to_floor, look_statistics
from slamgym.metrics.two_sample import distinguish, half_against_half, tree_learner
from slamgym.parametric import deform, map_along_path

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

MODULES = ("slamgym/parametric",)
"""What is measured."""

METHODS = ("generator", "parametric", "modelprog", "elastic")
CELL = 0.05
LEAST_FLOOR = 4.0
"""Maps that show less are left out, as by `slamgym dataset realism` [m^2]."""


class Maker:
    """Makes the maps of all methods."""

    def __init__(self, methods: Sequence[str]) -> None:
        if "modelprog" in methods:
            self._modelprog = load_translator("modelprog", "cad2slam")

    def make(
        self, method: str, plan: FloorPlan, path: Trajectory, episode: EpisodeConfig, seed: int
    ) -> tuple[OccupancyGrid, float]:
        """A map in the plan's frame, and its CPU seconds; the seed is the exploration's that drove the path."""
        rng = np.random.default_rng(seed)
        frame = GridFrame.covering(plan.bounds, CELL, 0.5)
        begun = time.process_time()
        if method == "generator":
            clutter = furnished(plan, episode.env, seed)
            grid = map_along_path(plan, path, episode.env, rng, clutter).grid
        elif method == "parametric":
            grid = deform(plan, path, rng=rng).grid
        else:
            cad = plan.raster(CELL, frame).cells
            if method == "elastic":
                cells, _ = bend_with_field(cad, CELL, rng)
            else:
                cells = self._modelprog.translate_cells(cad, CELL, drift=rng)
            grid = OccupancyGrid(cells, frame)
        return grid, time.process_time() - begun


def simulated(root: Path, record: PairRecord) -> tuple[FloorPlan, Trajectory, OccupancyGrid]:
    """The plan, the true path and the map of a pair, all in the plan's frame."""
    plan, path = recorded_drive(root, record)
    frame = record.frame
    x, y, _ = record.start
    moved = GridFrame(frame.resolution, frame.origin_x + x, frame.origin_y + y, *frame.shape)
    return plan, path, OccupancyGrid(read_png(Layout(root).image("B", record.name)), moved)


def looks(grid: OccupancyGrid) -> ByteArray:
    """A map as it is compared."""
    return at_look_cell(grid.cells, grid.frame.resolution)


def half_of(plan_id: str) -> int:
    """Which half of the plans one belongs to."""
    return hashlib.sha256(plan_id.encode()).digest()[0] % 2


def shows_floor(grid: OccupancyGrid) -> bool:
    """True if a map shows enough to be measured."""
    return float((cut_to_floor(looks(grid)) == FREE).sum()) * CELL**2 >= LEAST_FLOOR


def disagreement(first: OccupancyGrid, second: OccupancyGrid) -> float:
    """Share of the cells that either map knows in which the two differ, on the first one's frame."""
    other = resample_map(second, first.frame)
    known = (first.cells != UNKNOWN) | (other != UNKNOWN)
    return float((first.cells != other)[known].mean()) if known.any() else 0.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("datasets", nargs="+", type=Path)
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=METHODS)
    parser.add_argument("--most", type=int, default=10_000, help="pairs of each recipe")
    parser.add_argument(
        "--half", type=int, choices=(0, 1), help="of the plans: the errors were fitted on 0"
    )
    arguments = parser.parse_args()
    maker = Maker(arguments.methods)
    of_recipe: dict[str, list[tuple[Path, PairRecord]]] = {}
    for root in arguments.datasets:
        for record in read_manifest(root):
            if arguments.half in (None, half_of(record.plan_id)):
                recipe = str(record.conditions.get(MIXTURE) or root.name)
                of_recipe.setdefault(recipe, []).append((root, record))
    rows: list[tuple[object, ...]] = []
    for recipe, pairs in sorted(of_recipe.items()):
        rows += judge(recipe, pairs[: arguments.most], maker, arguments.methods)
    columns = ("recipe", "maps", "pairs", "trees", "disagreement", "of simulated", "CPU s", "90 %")
    title = "Telling generated from simulated maps (0.5 is perfect), and diversity"
    print_and_save("parametric/deform_realism", title, rows, columns, MODULES)


def judge(
    name: str, pairs: Sequence[tuple[Path, PairRecord]], maker: Maker, methods: Sequence[str]
) -> list[tuple[object, ...]]:
    """Rows of one recipe."""
    found = [(record, simulated(root, record)) for root, record in pairs]
    found = [(record, pair) for record, pair in found if shows_floor(pair[2])]
    records, true = [record for record, _ in found], [pair for _, pair in found]
    plans = [record.plan_id for record in records]
    of_plan: dict[str, list[int]] = {}
    for index, record in enumerate(records):
        if "turn_deg" not in record.conditions:  # two maps of a building lie alike
            of_plan.setdefault(record.plan_id, []).append(index)
    twice = [indices[:2] for indices in of_plan.values() if len(indices) > 1]
    spread = np.array([disagreement(true[a][2], true[b][2]) for a, b in twice])
    own = [look_statistics(cut_to_floor(looks(grid))) for _, _, grid in true]
    null = half_against_half(plans, tree_learner(own), 5, 5)
    rows: list[tuple[object, ...]] = [
        (name, "simulated, half against half", len(own), with_bounds(null),
         round(float(spread.mean()), 3) if len(spread) else None, None, None, None)
    ]  # fmt: skip
    for method in methods:
        made = [
            maker.make(
                method,
                plan,
                path,
                apply_conditions(EpisodeConfig(), record.conditions),
                record.seed,
            )
            for (plan, path, _), record in zip(true, records, strict=True)
        ]
        of_second = np.arange(2 * len(own)) >= len(own)
        statistics = own + [look_statistics(cut_to_floor(looks(grid))) for grid, _ in made]
        trees = distinguish(of_second, plans * 2, tree_learner(statistics), 5, 3)
        differs = np.array([disagreement(made[a][0], made[b][0]) for a, b in twice])
        ratio = None
        if len(twice):
            resampled = np.random.default_rng(0).integers(len(twice), size=(2000, len(twice)))
            low, high = np.percentile(
                differs[resampled].mean(axis=1) / spread[resampled].mean(axis=1), [2.5, 97.5]
            )
            ratio = f"{differs.mean() / spread.mean():.2f} [{low:.2f}, {high:.2f}]"
        seconds = [taken for _, taken in made]
        rows.append(
            (name, method, len(made), with_bounds(trees),
             round(float(differs.mean()), 3) if len(differs) else None, ratio,
             round(float(np.median(seconds)), 3), round(float(np.percentile(seconds, 90)), 3))
        )  # fmt: skip
        print(rows[-1], flush=True)
    return rows


if __name__ == "__main__":
    main()
