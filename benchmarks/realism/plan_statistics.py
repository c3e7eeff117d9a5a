"""Comparison of generated floor plans with HouseExpo: do they have the same statistics?

    python benchmarks/realism/plan_statistics.py [--houseexpo json.tar.gz]

HouseExpo's column holds the figures measured once over a sample of its plans, or is measured again from the
archive that is given.
"""

import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from shapely import Polygon

from slamgym.cad import FloorPlan, PlanGeneratorConfig, PlanSource, open_plans
from slamgym.cad.doors import SIMPLIFY, find_openings
from slamgym.cad.sources import generated_plans
from slamgym.core.errors import PlanError

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

MODULES = ("slamgym/cad",)
"""What is measured."""


@dataclass(frozen=True)
class PlanStatistics:
    """The measured figures of one plan."""

    rooms: int
    area: float
    """Free space [m2]."""
    long_side: float
    """Longer side of the bounding box [m]."""
    aspect: float
    """Longer side over shorter side."""
    fill: float
    """Free space over bounding box."""
    vertices: int
    """Corners after simplification by 3 cm."""
    holes: int
    """Walls, pillars and islands that can be walked round."""
    opening_widths: tuple[float, ...]
    """Clear widths of the doors and wider openings that :func:`find_openings` finds [m]."""

    @property
    def openings(self) -> int:
        """Number of openings."""
        return len(self.opening_widths)


def measure_plan(plan: FloorPlan) -> PlanStatistics:
    """Measure one plan."""
    min_x, min_y, max_x, max_y = plan.bounds
    short, long = sorted((max_x - min_x, max_y - min_y))
    simple = plan.free_space.simplify(SIMPLIFY)
    assert isinstance(simple, Polygon)
    corners = [len(ring.coords) - 1 for ring in (simple.exterior, *simple.interiors)]
    return PlanStatistics(
        rooms=len(plan.rooms),
        area=plan.area,
        long_side=long,
        aspect=long / short,
        fill=plan.area / (short * long),
        vertices=sum(corners),
        holes=len(simple.interiors),
        opening_widths=tuple(door.width for door in find_openings(simple)),
    )


FIGURES: dict[str, Callable[[PlanStatistics], float]] = {
    "rooms": lambda plan: plan.rooms,
    "free area, m2": lambda plan: plan.area,
    "long side, m": lambda plan: plan.long_side,
    "aspect": lambda plan: plan.aspect,
    "fill of the bounding box": lambda plan: plan.fill,
    "vertices (3 cm)": lambda plan: plan.vertices,
    "openings": lambda plan: plan.openings,
}
WIDTH_CLASSES = ((0.65, 0.85), (0.85, 1.05), (1.05, 1.35), (1.35, 2.5))  # [m]

# By this program over a sample of 3,000 of HouseExpo's 23,647 training plans.
PUBLISHED: dict[str, str] = {
    "rooms": "6 (2-14)",
    "free area, m2": "108 (29.3-360)",
    "long side, m": "14 (6.51-28.4)",
    "aspect": "1.37 (1.02-2.56)",
    "fill of the bounding box": "0.832 (0.564-0.988)",
    "vertices (3 cm)": "42 (12-97)",
    "openings": "4 (0-12)",
    "opening width, m": "1.21 (0.742-2.32)",
    "openings of 0.65-0.85 m": "16%",
    "openings of 0.85-1.05 m": "21%",
    "openings of 1.05-1.35 m": "18%",
    "openings of 1.35-2.50 m": "42%",
    "plans with a way round something": "0%",
}


@dataclass
class Arguments:
    """Compare generated plans with HouseExpo."""

    houseexpo: Path | None = None
    """The data set's json.tar.gz, or a folder of its plans, to measure it again."""
    count: int = 1000
    """Plans of each kind to generate, and of HouseExpo to measure."""
    seed: int = 0
    """Seed of the generated plans and of HouseExpo's sample."""


def main(arguments: Arguments) -> None:
    columns = {
        kind: describe(load(generated_plans(arguments.seed, config, arguments.count)))
        for kind, config in (
            ("homes", PlanGeneratorConfig(kind="home")),
            ("offices", PlanGeneratorConfig(kind="office")),
        )
    }
    houseexpo = PUBLISHED
    if arguments.houseexpo is not None:
        source = open_plans(arguments.houseexpo)
        rng = np.random.default_rng(arguments.seed)
        sample = rng.permutation(len(source))[: arguments.count]
        houseexpo = describe(load(source, [source.ids[index] for index in sample]))
    rows = [
        [figure, houseexpo.get(figure, "-"), *(column[figure] for column in columns.values())]
        for figure in columns["homes"]
    ]
    print_and_save(
        "realism/plan_statistics",
        f"Floor plans: median (5th-95th percentile), {arguments.count} of each kind",
        rows,
        ["figure", "HouseExpo", *(f"generated {kind}" for kind in columns)],
        MODULES,
    )


def load(source: PlanSource, ids: Iterable[str] | None = None) -> Iterable[FloorPlan]:
    for plan_id in source.ids if ids is None else ids:
        try:
            yield source.load(plan_id)
        except PlanError:
            continue


def describe(plans: Iterable[FloorPlan]) -> dict[str, str]:
    measured = [measure_plan(plan) for plan in plans]
    column = {}
    for figure, value in FIGURES.items():
        low, median, high = np.percentile([value(plan) for plan in measured], [5, 50, 95])
        column[figure] = f"{median:.3g} ({low:.3g}-{high:.3g})"
    widths = np.array([width for plan in measured for width in plan.opening_widths])
    column["opening width, m"] = "{1:.3g} ({0:.3g}-{2:.3g})".format(
        *np.percentile(widths, [5, 50, 95])
    )
    for low, high in WIDTH_CLASSES:
        share = np.mean((widths >= low) & (widths < high))
        column[f"openings of {low:.2f}-{high:.2f} m"] = f"{share:.0%}"
    column["plans with a way round something"] = (
        f"{np.mean([plan.holes > 0 for plan in measured]):.0%}"
    )
    return column


if __name__ == "__main__":
    main(tyro.cli(Arguments))
