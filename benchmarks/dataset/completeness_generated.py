"""Is the classifier of completeness as good if it learns from generated maps instead of simulated ones?

Explorations are looked at in the middle, as for the classifier itself. For each of those moments `deform`'s generator
draws a map of the same plan along the path driven by then. Trees learn from the simulated maps, from the generated
ones, and from both; all are judged on simulated maps of plans that they haven't seen.

    python benchmarks/dataset/completeness_generated.py DATASET [--most 200]

DATASET was made by `slamgym generate`.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

from slamgym.cad import FloorPlan
from slamgym.commands.deforming.hypotheses import furnished, recorded_drive, recorded_settings
from slamgym.core.errors import SlamgymError
from slamgym.core.progress import show_progress
from slamgym.core.types import BoolArray, FloatArray, Trajectory
from slamgym.dataset.curate.completeness import completeness_features
from slamgym.dataset.format import read_manifest
from slamgym.dataset.generate.recipe import apply_conditions
from slamgym.dataset.record import GOOD_COVERAGE
from slamgym.envs import ExploreConfig
from slamgym.parametric import map_along_path

sys.path.insert(0, str(Path(__file__).parents[1]))
from dataset.completeness import BAND, calibration_error, intervals
from dataset.completeness_training import Trees, cross_fit, score_probabilities, take_snapshots
from report import print_and_save

MINUTES = (0.5, 1.0, 2.0, 4.0)


def generated(plan: FloorPlan, path: Trajectory, env: ExploreConfig, seed: int) -> FloatArray:
    """Features of a map that the generator draws along a path."""
    rng, clutter = np.random.default_rng(seed), furnished(plan, env, seed)
    grid = map_along_path(plan, path, env, rng, clutter).grid
    return completeness_features(grid.cells, grid.frame.resolution)


def collect(root: Path, most: int) -> tuple[FloatArray, FloatArray, BoolArray, list[str]]:
    """Features of simulated and of generated maps (N, 15), which are complete, and their plans."""
    simulated, drawn, complete, plans = [], [], [], []
    base = recorded_settings(root)
    records = list(read_manifest(root))[:most]
    with show_progress("pairs", 0, len(records)) as advance:
        for record in records:
            plan, driven = recorded_drive(root, record)
            env = apply_conditions(base, record.conditions).env
            for moment in take_snapshots(root, record, MINUTES):
                until = int(np.searchsorted(driven.stamps, moment.time, side="right"))
                path = Trajectory(driven.stamps[:until], driven.poses[:until])
                try:
                    features = generated(plan, path, env, record.seed)
                except SlamgymError:  # a path too short to draw anything
                    continue
                simulated.append(completeness_features(moment.cells, moment.resolution))
                drawn.append(features)
                complete.append(moment.coverage >= GOOD_COVERAGE)
                plans.append(record.plan_id)
            advance()
    return np.array(simulated), np.array(drawn), np.array(complete), plans


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--most", type=int, default=200, help="explorations")
    arguments = parser.parse_args()
    simulated, drawn, complete, plans = collect(arguments.dataset, arguments.most)
    learned_from = {
        "simulated maps": (simulated, complete, plans),
        "generated maps": (drawn, complete, plans),
        "both": (np.concatenate([simulated, drawn]), np.tile(complete, 2), plans * 2),
    }
    rows: list[tuple[object, ...]] = []
    for name, (features, labels, ids) in learned_from.items():
        model = cross_fit(features, labels, ids, Trees())
        said = model.probabilities(simulated, plans)
        score = score_probabilities(said, complete, BAND)
        low, high = intervals(said, complete, np.array(plans))
        rows.append(
            (name, len(labels), score.count, int(complete.sum()),
             f"{score.roc_auc:.3f} [{low.roc_auc:.3f}, {high.roc_auc:.3f}]",
             round(score.brier, 3), round(calibration_error(said, complete), 3), round(score.accuracy, 3))
        )  # fmt: skip
    columns = (
        "learned from",
        "maps",
        "judged on",
        "complete",
        "AUC",
        "Brier score",
        "calibration error",
        "accuracy",
    )
    title = "The classifier of completeness by what it learned from, on simulated maps of other plans"
    print_and_save("dataset/completeness_generated", title, rows, columns)


if __name__ == "__main__":
    main()
