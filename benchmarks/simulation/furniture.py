"""Draw furnished plans on one sheet, and compare a furnished reset with an empty one.

    python benchmarks/simulation/furniture.py [--plans json.tar.gz] [--count 12] [--out furniture.png]

Red is what stands, blue what may be moved (chairs, doors' leaves), green the floor that pieces cover.
"""

import sys
import time
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import tyro

from slamgym.cad import FloorPlan, open_plans
from slamgym.core.types import ByteArray, FloatArray
from slamgym.envs import ExploreEnv
from slamgym.sim import Clutter, ClutterConfig, make_clutter

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

MODULES = ("slamgym/sim",)
"""What is measured."""

SIDE = 480
COLUMNS = 4
SHIFT = 4
CLUTTER = ClutterConfig(furniture=1.0, doors=0.7)


@dataclass(frozen=True)
class Arguments:
    """Pictures of furnished plans, and what a reset costs."""

    plans: str = "bundled"
    count: int = 12
    out: Path = Path("furniture.png")


def draw(plan: FloorPlan, clutter: Clutter) -> ByteArray:
    """A plan with its clutter, shape (SIDE, SIDE, 3), BGR."""
    low, high = np.reshape(plan.bounds, (2, 2))
    scale = (SIDE - 20) / float((high - low).max())

    def pixels(points: FloatArray) -> np.ndarray:
        moved = (points - low) * scale * [1, -1] + [10, SIDE - 10]
        return np.round(moved * 2**SHIFT).astype(np.int32)

    image: ByteArray = np.full((SIDE, SIDE, 3), 255, dtype=np.uint8)
    along = clutter.outlines[:, 2:4] * clutter.outlines[:, 4:5]
    across = clutter.outlines[:, [3, 2]] * [-1.0, 1.0] * clutter.outlines[:, 5:6]
    covered = np.stack([-along - across, along - across, along + across, across - along], axis=1)
    moving = [solid for places in clutter.movables for solid in places[0]]
    fills = (
        (covered + clutter.outlines[:, None, :2], (225, 235, 225)),
        (clutter.furniture, (60, 60, 200)),
    )
    for solids, colour in (*fills, (moving, (200, 60, 60))):
        for corners in solids:
            cv2.fillPoly(image, [pixels(corners)], colour, cv2.LINE_AA, SHIFT)
    lines = [pixels(segment.reshape(2, 2)) for segment in plan.segments()]
    cv2.polylines(image, lines, False, (0, 0, 0), 2, cv2.LINE_AA, SHIFT)
    return image


def main(arguments: Arguments) -> None:
    """Draw, then measure."""
    source = open_plans(arguments.plans)
    plans = [source.load(plan_id) for plan_id in source.ids[: arguments.count]]
    images = [
        draw(plan, make_clutter(plan, np.random.default_rng(seed), CLUTTER))
        for seed, plan in enumerate(plans)
    ]
    images += [np.full_like(images[0], 255)] * (-len(images) % COLUMNS)
    rows = [np.hstack(images[first : first + COLUMNS]) for first in range(0, len(images), COLUMNS)]
    cv2.imwrite(str(arguments.out), np.vstack(rows))
    resets = []
    for name, clutter in (("empty", ClutterConfig()), ("furnished", CLUTTER)):
        env = ExploreEnv(plans, localization="ground_truth", clutter=clutter)
        env.reset(seed=0)
        begin = time.process_time()
        for seed, plan in enumerate(plans):
            env.reset(seed=seed, options={"plan": plan})
        resets.append([name, 1e3 * (time.process_time() - begin) / len(plans)])
    columns = ["homes", "ms a reset"]
    print_and_save(
        "simulation/furnished_resets",
        "Resets, CPU time",
        resets,
        columns,
        MODULES,
        times=columns[1:],
    )
    print(arguments.out)


if __name__ == "__main__":
    main(tyro.cli(Arguments))
