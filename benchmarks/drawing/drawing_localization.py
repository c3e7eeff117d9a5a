"""Does a robot find itself on a drawing as well as on the SLAM map that the drawing was made from?

    python benchmarks/drawing/drawing_localization.py [--homes 24] [--models slam2cad,none]

Every home is mapped by the particle filter. Later a robot drives there for three minutes with new errors of wheels and
laser, knowing nothing of its start. In every third home both find it empty; in every third it was empty and is
furnished when the robot comes back; in every third it was furnished and all furniture has moved. The robot is localised
on the raw map, on drawings of that map, and on the true plan. All are localised with one log, so the maps
are compared home by home. *Right* is defined as in ``localization.py``: against where the SLAM map says that the place
is, for drawings too, which lie in its frame. *Sure and wrong* is the share of scans with ``localised`` and not right.
"""

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from slamgym.cad import PlanGeneratorConfig, generate_plan
from slamgym.core.intervals import mean_interval, wilson_interval
from slamgym.core.progress import say
from slamgym.core.types import UNKNOWN
from slamgym.drawing import Drawing, drawing_map, load_floor_model, make_drawing
from slamgym.drawing.formats.png import draw_picture
from slamgym.envs import Episode
from slamgym.viz.canvas import write_picture

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save
from slam.localization import SECONDS, Drive, Outcome, explore, on_map, placed

MODULES = ("slamgym/drawing", "slamgym/slam")
"""What is measured."""

FIRST_HOME = 5100
"""Homes from this number on were not used when any setting was chosen."""
FURNITURE = 0.3
"""Share of the usual furniture, as in ``localization.py``."""
STATES = {
    "nothing": (0.0, 0.0),
    "furniture has come": (0.0, FURNITURE),
    "all furniture has moved": (FURNITURE, FURNITURE),
}
"""Changes, and how furnished the home is when it is mapped and later."""
RAW = "raw SLAM map"
COLUMNS = (
    "what has changed", "localised on", "drives", "right within 60 s", "[95 %]", "median time [s]", "error [m]",
    "[95 %] of the error", "error minus raw [m]", "[95 %] of that", "localised [%]", "minus raw [%]",
    "[95 %] of the share", "sure and wrong [% of scans]", "drives with any", "ms a scan",
)  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--homes", type=int, default=24)
    parser.add_argument("--models", default="slam2cad,none")
    parser.add_argument("--pictures", type=Path, help="folder for pictures of the drawings")
    arguments = parser.parse_args()
    models = {name: load_floor_model(name) for name in arguments.models.split(",")}
    outcomes: dict[str, dict[str, list[Outcome]]] = {state: {} for state in STATES}
    for number in range(arguments.homes):
        state = list(STATES)[number % len(STATES)]
        begun = time.process_time()
        mapping, drive, plan = drives(FIRST_HOME + number, *STATES[state])
        found = outcomes[state]
        found.setdefault(RAW, []).append(on_map(drive, mapping.slam_map, mapping))
        for name, model in models.items():
            drawing = make_drawing(mapping.slam_map, f"{FIRST_HOME + number}", model)
            one = on_map(drive, drawing_map(drawing), mapping)
            found.setdefault(f"its drawing ({name})", []).append(one)
            if arguments.pictures:
                picture(arguments.pictures / f"{number:02}_{name}.png", drawing)
        true = plan.raster(0.05, offset=(mapping.start.x, mapping.start.y), outside=UNKNOWN)
        found.setdefault("true plan", []).append(on_map(drive, true, None))
        shown = {
            name: f"{of[-1].seconds:.0f} s, {of[-1].wrong:.1%} wrong" for name, of in found.items()
        }
        say(f"{number} {state} {shown} {time.process_time() - begun:.0f} CPU s")
    rows = [
        row(state, name, found[name], found[RAW])
        for state, found in [*outcomes.items(), ("any of these", together(outcomes))]
        for name in found
    ]
    print_and_save(
        "drawing/localization", f"localisation in {arguments.homes} homes", rows, COLUMNS, MODULES
    )


def drives(seed: int, before: float, after: float) -> tuple[Episode, Drive, Any]:
    """The drive that makes the map, one in the home as it is furnished later, and the plan."""
    plan = generate_plan(seed, PlanGeneratorConfig(kind="home"))
    mapping = explore(plan, seed, "rbpf", furniture=before)
    later = explore(plan, 10_000 + seed, "ground_truth", 3.0, furniture=after)
    return mapping, placed(later, mapping.start), plan


def together(outcomes: dict[str, dict[str, list[Outcome]]]) -> dict[str, list[Outcome]]:
    """All homes, in the same order for every map."""
    kinds = list(outcomes.values())
    return {name: [one for found in kinds for one in found[name]] for name in kinds[0]}


def row(state: str, name: str, found: Sequence[Outcome], raw: Sequence[Outcome]) -> dict[str, Any]:
    """All drives on one kind of map; differences are of the homes where both have a value."""
    right = wilson_interval(sum(one.seconds <= SECONDS for one in found), len(found))
    errors, minus = means(found, raw, lambda one: one.errors.mean() if len(one.errors) else np.nan)
    shares, gained = means(found, raw, lambda one: 100.0 * one.localised)
    seconds = float(np.median([one.seconds for one in found]))
    values = (
        state, name, len(found), f"{right.value:.0%}", f"{right.low:.0%}-{right.high:.0%}",
        round(seconds, 1) if np.isfinite(seconds) else None, *shown(errors, 3), *shown(minus, 3),
        shown(shares, 1)[0], *shown(gained, 1), round(100.0 * float(np.mean([one.wrong for one in found])), 2),
        sum(one.wrong > 0.0 for one in found), round(float(np.median([one.ms for one in found])), 2),
    )  # fmt: skip
    return dict(zip(COLUMNS, values, strict=True))


def means(
    found: Sequence[Outcome], raw: Sequence[Outcome], of: Callable[[Outcome], float]
) -> tuple[np.ndarray, np.ndarray]:
    """A figure of all drives, and its comparison with the raw map's, home by home; without what has none."""
    own, other = (np.array([of(one) for one in all_of]) for all_of in (found, raw))
    difference = own - other
    return own[np.isfinite(own)], difference[np.isfinite(difference)]


def shown(values: np.ndarray, digits: int) -> tuple[float | None, str]:
    """Mean and interval."""
    if len(values) < 2:
        return None, ""
    interval = mean_interval(values)
    return round(interval.value, digits), f"{interval.low:.{digits}f} to {interval.high:.{digits}f}"


def picture(path: Path, drawing: Drawing) -> None:
    write_picture(path, draw_picture(drawing, 700))


if __name__ == "__main__":
    main()
