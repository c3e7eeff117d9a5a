"""Number of HouseExpo's floor plans that look like another one, cost of finding them, and share of made ones found.

Plans are drawn at random from the archive and filtered as ``slamgym generate --plans-filter useful`` does.
Groups are those that ``slamgym dataset split`` keeps on one side. Look-alikes are made of some of the plans by resizing
and turning them.
"""

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from shapely.affinity import rotate, scale

from slamgym.cad import FloorPlan, open_plans
from slamgym.cad.plan_filter import passes
from slamgym.core.errors import PlanError
from slamgym.dataset.curate.near_duplicates import RADIUS, near_duplicates, plan_print

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

MODULES = ("slamgym/dataset",)
"""What is measured."""

CHANGES = [
    (0.8, 0.0),
    (0.95, 0.0),
    (1.2, 0.0),
    (1.0, 1.0),
    (1.0, 2.0),
    (1.0, 3.0),
    (0.95, 2.0),
    (1.2, 3.0),
]
"""Factor of the size and turn [deg] of the look-alikes."""


@dataclass(frozen=True)
class Arguments:
    """Groups of floor plans that look alike."""

    plans: tyro.conf.Positional[str]
    """HouseExpo plans: a folder or a .tar.gz."""
    draw: int = 9000
    """Plans that are drawn before the filter."""
    made: int = 300
    """Plans of which look-alikes are made."""
    seed: int = 0
    """Seed of the draw."""


def main() -> None:
    arguments = tyro.cli(Arguments)
    source = open_plans(arguments.plans)
    plans: list[FloorPlan] = []
    began = time.process_time()
    for plan_id in np.random.default_rng(arguments.seed).permutation(source.ids)[: arguments.draw]:
        try:
            plan = source.load(plan_id)
        except PlanError:
            continue
        if passes(plan, "useful"):
            plans.append(plan)
    reading = time.process_time() - began
    began = time.process_time()
    prints = np.stack([plan_print(plan) for plan in plans])
    drawing = time.process_time() - began
    measure_groups(prints, reading, drawing)
    measure_recall(plans[: arguments.made], prints)


def measure_groups(prints: np.ndarray, reading: float, drawing: float) -> None:
    """Group the plans of the archive."""
    rows = []
    for radius in (0.75 * RADIUS, RADIUS, 1.25 * RADIUS):
        began = time.process_time()
        groups = near_duplicates(prints, radius)
        comparing = time.process_time() - began
        sizes = np.unique(groups, return_counts=True)[1]
        found = len(prints), len(sizes), int(sizes[sizes > 1].sum()), int(sizes.max())
        rows.append([radius, *found, reading, drawing, comparing])
    title = f"plans that look alike (`slamgym dataset split` takes a radius of {RADIUS:g})"
    columns = ["radius", "plans", "groups", "plans that share one", "largest group"]
    times = ["reading [CPU s]", "drawing [CPU s]", "comparing [CPU s]"]
    print_and_save("dataset/plan_look_alikes", title, rows, [*columns, *times], MODULES, times)


def measure_recall(plans: Sequence[FloorPlan], prints: np.ndarray) -> None:
    """Hide look-alikes of some plans among all, and see whether each is put with its original."""
    rows = []
    for factor, turn in CHANGES:
        made = [
            FloorPlan(
                plan.id, rotate(scale(plan.free_space, factor, factor), turn, origin=(0.0, 0.0))
            )
            for plan in plans
        ]
        groups = near_duplicates(np.concatenate([prints, [plan_print(plan) for plan in made]]))
        share = float(np.mean(groups[: len(made)] == groups[len(prints) :]))
        rows.append([factor, turn, round(100.0 * share, 1)])
    title = f"resized and turned plans that are put with their originals, of {len(plans)}"
    columns = ["size", "turn [deg]", "found [%]"]
    print_and_save("dataset/plan_look_alikes_found", title, rows, columns, MODULES)


if __name__ == "__main__":
    main()
