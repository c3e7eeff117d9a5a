"""How many floor plans of HouseExpo look like another one, and what it costs to find them.

Plans are drawn at random from the archive and filtered as ``slamgym generate --plans-filter useful`` does.
Groups are those that ``slamgym dataset split`` keeps on one side.
"""

import time
from dataclasses import dataclass

import numpy as np
import tyro
from report import print_and_save

from slamgym.cad import open_plans
from slamgym.cad.plan_filter import passes
from slamgym.core.errors import PlanError
from slamgym.dataset.curate.near_duplicates import RADIUS, near_duplicates, plan_print


@dataclass(frozen=True)
class Arguments:
    """Groups of floor plans that look alike."""

    plans: tyro.conf.Positional[str]
    """HouseExpo plans: a folder or a .tar.gz."""
    draw: int = 9000
    """Plans that are drawn before the filter."""
    seed: int = 0
    """Seed of the draw."""


def main() -> None:
    arguments = tyro.cli(Arguments)
    source = open_plans(arguments.plans)
    prints, sides = [], []
    began = time.process_time()
    for plan_id in np.random.default_rng(arguments.seed).permutation(source.ids)[: arguments.draw]:
        try:
            plan = source.load(plan_id)
        except PlanError:
            continue
        if passes(plan, "useful"):
            min_x, min_y, max_x, max_y = plan.bounds
            prints.append(plan_print(plan))
            sides.append(max(max_x - min_x, max_y - min_y))
    reading = time.process_time() - began
    rows = []
    for radius in (0.5 * RADIUS, RADIUS, 1.25 * RADIUS):
        began = time.process_time()
        groups = near_duplicates(np.stack(prints), np.array(sides), radius)
        comparing = time.process_time() - began
        sizes = np.unique(groups, return_counts=True)[1]
        rows.append(
            [
                radius,
                len(prints),
                len(sizes),
                int(sizes[sizes > 1].sum()),
                int(sizes.max()),
                reading,
                comparing,
            ]
        )
    title = f"plans that look alike (`slamgym dataset split` takes a radius of {RADIUS:g})"
    columns = [
        "radius",
        "plans",
        "groups",
        "plans that share one",
        "largest group",
        "reading and drawing [CPU s]",
    ]
    print_and_save("dataset/plan_look_alikes", title, rows, [*columns, "comparing [CPU s]"])


if __name__ == "__main__":
    main()
