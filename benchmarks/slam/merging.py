"""Merging: pairs of drives through one building, and pairs that only look alike.

    python benchmarks/slam/merging.py CACHE [--buildings 66] [--chosen] [--manners graphs]

Each building (three homes to an office) is driven through twice, from other starts, with other lengths, headings of
the odometry and, by chance, other lasers; once in its mirror image; and once in a storey of the same rooms with other
doors. The first 22 buildings chose the thresholds (``--chosen`` shows those); the figures are of the others. What was
found of a building is kept in the cache, so that a run can be stopped and go on. *Right* is
a transform within 10 cm and 1 degree of the truth in the middle of the second map, each map being laid on its true
path as well as it can be. *Wrong* is anything else that is merged. Recorded logs are cut in two without a scan in
common; the relations over both halves, merged, are compared with those of the whole log.
"""

import argparse
import json
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from merging_drives import CHOSEN, FIRST, MappedDrive, mapped_drives
from report import print_and_save

from slamgym.core.geometry import compose, inverse, transform_points, wrap_angle
from slamgym.core.intervals import median_interval, wilson_interval
from slamgym.core.types import FREE, FloatArray, Pose2D
from slamgym.metrics.map_error import ObstacleDistance
from slamgym.metrics.trajectory import align_se2
from slamgym.slam.graph.map_graph import MapGraph
from slamgym.slam.merge.merged import Merged, merge_parts
from slamgym.slam.merge.merging import Part
from slamgym.slam.merge.verdict import SAME_BUILDING, UNKNOWN_BUILDINGS, Odds

MODULES = ("slamgym/slam/merge", "slamgym/slam/graph")
"""What is measured."""
OVERLAP = 0.3
"""Pairs with less floor in common, as a share of the smaller map's, are not counted."""
RIGHT_CASE = "one building"
PICTURES, TOLD = ", pictures alone", ", told so"
"""Pairs without their graphs, and pairs of which someone says that they are of one building."""
MANNERS = {"graphs": "", "pictures": PICTURES, "told": TOLD}
RIGHT_METRES, RIGHT_DEGREES = 0.1, 1.0
COLUMNS = (
    "case", "pairs", "right", "right 95 % low", "refused", "wrong", "wrong 95 % high", "error [m]", "error 95 % high",
    "turn [deg]", "walls / better one", "CPU s",
)  # fmt: skip


class Outcome(NamedTuple):
    """One pair at its best place."""

    evidence: float  # [nats]
    margin: float  # over the best other place [nats]
    agreed: float  # wall on wall [m]
    contradicted: float  # wall on free floor [m]
    metres: float  # from the true transform; infinite where there is none
    degrees: float
    walls: float  # error of the merged map / that of the better one
    seconds: float

    def is_merged(self, odds: Odds) -> bool:
        """It is sure."""
        return self.evidence >= odds.sure and self.margin >= odds.margin

    @property
    def is_right(self) -> bool:
        """The place is the true one."""
        return self.metres < RIGHT_METRES and self.degrees < RIGHT_DEGREES


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("cache", type=Path)
    parser.add_argument("--buildings", type=int, default=66)
    parser.add_argument("--chosen", action="store_true")
    parser.add_argument("--manners", nargs="+", choices=list(MANNERS), default=list(MANNERS))
    arguments = parser.parse_args()
    first = FIRST if arguments.chosen else FIRST + CHOSEN
    count = CHOSEN if arguments.chosen else arguments.buildings
    cases: dict[str, list[Outcome]] = {}
    for manner in arguments.manners:
        for number in range(first, first + count):
            for case, outcome in outcomes_of(number, number == first, manner, arguments.cache):
                cases.setdefault(case, []).append(outcome)
    rows = [row(case, cases[case]) for case in sorted(cases, key=_order)]
    name = "slam/merging_chosen" if arguments.chosen else "slam/merging"
    title = f"merging the maps of {count} buildings"
    print_and_save(name, title, rows, COLUMNS, MODULES, times=("CPU s",))


def _order(case: str) -> tuple[bool, bool]:
    return "pictures" in case, "one building" not in case


def outcomes_of(number: int, is_first: bool, manner: str, cache: Path) -> list[tuple[str, Outcome]]:
    """The pairs of a building, from the cache, or merged and put there."""
    path = cache / "outcomes" / f"{number}-{manner}.json"
    if not path.exists():
        drives = mapped_drives(number, cache)
        before = None if is_first else mapped_drives(number - 1, cache, ("second",))["second"]
        parts: dict[int, tuple[Part, float]] = {}
        found = []
        for case, one, other in pairs(drives, before, MANNERS[manner]):
            found.append((case, judged(one, other, case, parts)))
            print(number, *found[-1], file=sys.stderr, flush=True)
        path.parent.mkdir(exist_ok=True)
        path.write_text(json.dumps(found))
    return [(case, Outcome(*values)) for case, values in json.loads(path.read_text())]


def pairs(
    drives: dict[str, MappedDrive], before: MappedDrive | None, manner: str
) -> Iterator[tuple[str, MappedDrive, MappedDrive]]:
    """Pairs of a building, with one of the building before."""
    first = drives["first"]
    others = {
        RIGHT_CASE: drives["second"],
        "mirror images": drives.get("mirrored"),
        "storeys of the same rooms": drives.get("storey"),
        "different buildings": before,
    }
    for case, other in others.items():
        if other is None or (case == RIGHT_CASE and overlap(first, other) < OVERLAP):
            continue
        yield case + manner, first, other
    if "furnished anew" in drives and manner == TOLD:
        yield (
            f"{RIGHT_CASE}, all furniture moved{TOLD}",
            drives["furnished"],
            drives["furnished anew"],
        )


def true_transform(first: MappedDrive, second: MappedDrive) -> Pose2D:
    """The pose of the second map's frame in the first's."""
    return compose(inverse(first.frame), second.frame)


def overlap(first: MappedDrive, second: MappedDrive) -> float:
    """Share of the smaller map's free floor that the other one shows, too."""
    one, other = first.graph.grid(), second.graph.grid()
    points = np.column_stack(other.frame.to_point(*np.nonzero(other.cells == FREE)))
    placed = transform_points(true_transform(first, second), points)
    rows, cols = one.frame.to_cell(placed[:, 0], placed[:, 1])
    height, width = one.cells.shape
    inside = (rows >= 0) & (cols >= 0) & (rows < height) & (cols < width)
    common = np.count_nonzero(one.cells[rows[inside], cols[inside]] == FREE)
    smaller = min(int(np.count_nonzero(one.cells == FREE)), len(points))
    return float(common / smaller)


def judged(
    first: MappedDrive, second: MappedDrive, case: str, parts: dict[int, tuple[Part, float]]
) -> Outcome:
    """Lay two maps on each other and compare with the truth; both are kept as parts, with the time that it took."""
    is_picture = PICTURES in case
    odds = SAME_BUILDING if TOLD in case else UNKNOWN_BUILDINGS
    for drive in (first, second):
        if id(drive) not in parts:
            begin = time.process_time()
            made = (picture if is_picture else Part.of_graph)("map", drive.graph)
            parts[id(drive)] = made, time.process_time() - begin
    (one_part, some), (other_part, more) = (parts[id(one)] for one in (first, second))
    begin = time.process_time()
    merged = merge_parts([one_part, other_part], guess=True, odds=odds)
    seconds = some + more + time.process_time() - begin
    if not isinstance(merged, Merged):
        return Outcome(-np.inf, 0.0, 0.0, 0.0, np.inf, np.inf, np.nan, seconds)
    verdict = merged.placed[1].verdict
    assert verdict is not None
    assert verdict.best is not None
    evidence, margin = verdict.best.evidence, verdict.best.evidence - verdict.rival
    agreement = verdict.best.agreement
    said = (evidence, margin, agreement.agreed, agreement.contradicted)
    if not case.startswith(RIGHT_CASE):
        return Outcome(*said, np.inf, np.inf, np.nan, seconds)
    one, other = first.frame, compose(second.frame, inverse(merged.placed[1].pose))
    walls = np.nan
    if merged.graph is not None:
        poses = merged.graph.poses
        count = len(first.graph.poses)
        one, other = (
            align_se2(some[:, :2], drive.truth.poses[:, :2])
            for some, drive in ((poses[:count], first), (poses[count:], second))
        )
        truth = np.concatenate([first.truth.poses, second.truth.poses])
        walls = wall_ratio(merged, align_se2(poses[:, :2], truth[:, :2]), first, second)
    middle = transform_points(inverse(other), second.truth.poses[:, :2].mean(axis=0))
    away = transform_points(one, middle) - transform_points(other, middle)
    turn = abs(np.degrees(wrap_angle(one.theta - other.theta)))
    return Outcome(*said, float(np.hypot(*away)), float(turn), walls, seconds)


def picture(name: str, graph: MapGraph) -> Part:
    """A map without its graph."""
    return Part.of_picture(name, graph.grid())


def wall_ratio(merged: Merged, frame: Pose2D, first: MappedDrive, second: MappedDrive) -> float:
    """Wall error of a merged map, whose frame's pose in the plan is given, over that of the better one of the two."""
    distance = ObstacleDistance(first.plan.segments())
    single = [distance.mean_error(drive.graph.grid(), drive.frame) for drive in (first, second)]
    return distance.mean_error(merged.grid(), frame) / min(single)


def row(case: str, outcomes: list[Outcome]) -> dict[str, Any]:
    """All pairs of one case."""
    odds = SAME_BUILDING if TOLD in case else UNKNOWN_BUILDINGS
    count = len(outcomes)
    merged = [outcome for outcome in outcomes if outcome.is_merged(odds)]
    right = [outcome for outcome in merged if outcome.is_right]
    wrong = len(merged) - len(right)
    errors = np.array([outcome.metres for outcome in right])
    walls = np.array([outcome.walls for outcome in right])
    return {
        "case": case,
        "pairs": count,
        "right": len(right),
        "right 95 % low": round(wilson_interval(len(right), count).low, 3),
        "refused": count - len(merged),
        "wrong": wrong,
        "wrong 95 % high": round(wilson_interval(wrong, count).high, 3),
        "error [m]": _median(errors),
        "error 95 % high": round(median_interval(errors).high, 4) if len(errors) else None,
        "turn [deg]": _median(np.array([outcome.degrees for outcome in right])),
        "walls / better one": _median(walls[np.isfinite(walls)]),
        "CPU s": round(float(np.median([outcome.seconds for outcome in outcomes])), 2),
    }


def _median(values: FloatArray) -> float | None:
    return round(float(np.median(values)), 4) if len(values) else None


if __name__ == "__main__":
    main()
