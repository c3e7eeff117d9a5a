"""Test of `slamgym cad compare` on known changes, by kind and size, on maps of simulated robots.

    python benchmarks/plan_comparison/plan_comparison.py WORK --houseexpo json.tar.gz [--furniture F] [--tb3-house DIR]

Buildings are changed (``changed_buildings.py``), explored by ``slamgym generate`` with its defaults, and each map is
compared with the plan before the change. The threshold for walls is chosen on the first half of the maps; the second
half reports. Explorations that are there already aren't made again.
"""

import itertools
import json
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
import tyro
from changed_buildings import Change, change_building

from slamgym.cad import FloorPlan, check_plan, open_plans, read_houseexpo, write_houseexpo
from slamgym.commands.cli import main as slamgym
from slamgym.core.errors import PlanError
from slamgym.core.intervals import wilson_interval
from slamgym.core.pictures import read_png
from slamgym.core.types import GridFrame, OccupancyGrid
from slamgym.drawing import ComparisonConfig
from slamgym.drawing.comparison import PlanFinding, compare_with_plan
from slamgym.interop import read_map

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import Yardsticks, print_and_save

MODULES = ("slamgym/drawing/comparison", "slamgym/slam")
"""What is measured."""

HOMES, OFFICES, HOUSEEXPO = 12, 3, 9
SAME_PLACE = 0.35
"""A change is the true one if it lies so near to it [m] and covers this share of it."""
SHARE = 0.4
FOLLOWS = 0.3
"""A report so near to a true change follows from it and is no false alarm [m]."""
BINS = ((0.0, 0.15), (0.15, 0.25), (0.25, 0.4), (0.4, 0.8))


@dataclass(frozen=True)
class Arguments:
    """Recall and precision of changes between plan and map."""

    work: tyro.conf.Positional[Path]
    """Folder for plans, changed buildings and maps."""
    houseexpo: Path | None = None
    """HouseExpo's archive; without it generated plans alone."""
    furniture: float = 0.0
    """Share of the usual furniture in the buildings; none of it is in the plans."""
    tb3_house: Path | None = None
    """TurtleBot3's house: its walls, and people's maps of it."""


@dataclass(frozen=True)
class Case:
    """A plan, the map of the changed building, and what was changed."""

    plan: FloorPlan
    grid: OccupancyGrid
    truth: list[Change]


def usable(source: Any, ids: list[str], areas: tuple[float, float]) -> Iterator[FloorPlan]:
    for plan_id in ids:
        try:
            plan = source.load(plan_id)
            check_plan(plan, max_extent=40.0)
        except PlanError:
            continue
        if areas[0] <= plan.area <= areas[1] and plan.num_vertices < 600:
            yield plan


def make_buildings(arguments: Arguments) -> None:
    """Write plans, changed buildings and the list of changes."""
    sources = [
        ("procedural:home:77", (60.0, 160.0), HOMES),
        ("procedural:office:loops:77", (100.0, 220.0), OFFICES),
    ]
    if arguments.houseexpo:
        sources.append((str(arguments.houseexpo), (60.0, 160.0), HOUSEEXPO))
    for spec, areas, count in sources:
        source = open_plans(spec)
        ids = list(source.ids)
        if spec == str(arguments.houseexpo):
            np.random.default_rng(0).shuffle(ids)
        for plan in itertools.islice(usable(source, ids, areas), count):
            built, changes = change_building(plan, np.random.default_rng([5, len(plan.id)]))
            write_houseexpo(arguments.work / "plans" / f"{plan.id}.json", plan)
            write_houseexpo(arguments.work / "built" / f"{plan.id}.json", built)
            rows = [
                {"kind": c.kind, "line": c.line, "offset": c.offset, "touched": c.touched.wkt}
                for c in changes
            ]
            (arguments.work / "plans" / f"{plan.id}.changes").write_text(json.dumps(rows))


def explored(arguments: Arguments) -> list[Case]:
    """The maps, in the order of the dataset."""
    if not (arguments.work / "built").exists():
        make_buildings(arguments)
    count = len(list((arguments.work / "built").glob("*.json")))
    folder = arguments.work / ("furnished" if arguments.furniture else "maps")
    # Another robot's noise in the furnished buildings.
    seed = 4 if arguments.furniture else 3
    options = [
        "--pairs",
        str(count),
        "--workers",
        "1",
        "--seed",
        str(seed),
        "--set",
        f"clutter.furniture={arguments.furniture}",
    ]
    slamgym(["generate", "--plans", str(arguments.work / "built"), "-o", str(folder), *options])
    records = [json.loads(line) for line in (folder / "manifest.jsonl").read_text().splitlines()]
    cases: dict[str, Case] = {}
    for record in sorted(records, key=lambda entry: entry["index"]):
        cells = read_png(folder / "B" / f"{record['name']}.png")
        grid = OccupancyGrid(
            cells, GridFrame(record["resolution"], *record["origin"], *record["shape"])
        )
        plan_file = arguments.work / "plans" / f"{record['plan_id']}.json"
        rows = json.loads(plan_file.with_suffix(".changes").read_text())
        truth = [
            Change(r["kind"], tuple(r["line"]), r["offset"], shapely.from_wkt(r["touched"]))
            for r in rows
        ]
        # Plans that can't be explored are made up for by second maps of others.
        cases.setdefault(record["plan_id"], Case(read_houseexpo(plan_file), grid, truth))
    return list(cases.values())


def is_at(found: PlanFinding, truth: Change) -> bool:
    """True if a reported change lies where a true one is."""
    line, true_line = (
        shapely.LineString(np.reshape(entry.line, (2, 2))) for entry in (found, truth)
    )
    shared = true_line.buffer(SAME_PLACE).intersection(line).length
    return bool(shared >= SHARE * min(line.length, true_line.length))


def finds(found: PlanFinding, truth: Change) -> bool:
    """True if a reported change is a true one, of the same kind."""
    kinds = {"wall_missing": {"wall_missing", "opening_new"}}.get(truth.kind, {truth.kind})
    if found.kind not in kinds or not is_at(found, truth):
        return False
    if truth.kind == "wall_moved":
        return offset_error(found, truth) < max(0.06, 0.4 * abs(truth.offset))
    return True


def offset_error(found: PlanFinding, truth: Change) -> float:
    """Error of a moved wall's offset [m]; both lines may run either way."""
    assert found.offset is not None
    first, second = (
        np.array(entry.line[2:]) - np.array(entry.line[:2]) for entry in (found, truth)
    )
    sign = 1.0 if first @ second > 0 else -1.0
    return abs(sign * found.offset - truth.offset)


def is_false(found: PlanFinding, truth: list[Change]) -> bool:
    """True if nothing has changed where a change is reported."""
    if found.kind == "room_unexplored":
        return False
    line = shapely.LineString(np.reshape(found.line, (2, 2)))
    return not any(line.distance(change.touched) < FOLLOWS for change in truth)


def kept(found: tuple[PlanFinding, ...], moved: float, sure: float) -> list[PlanFinding]:
    """Changes that remain with stricter thresholds for moved walls."""
    return [
        c for c in found
        if c.kind != "wall_moved" or (abs(c.offset or 0.0) > moved and abs(c.offset or 0.0) > sure * (c.error or 0.0))
    ]  # fmt: skip


def choose_threshold(cases: list[Case]) -> tuple[float, float]:
    """The thresholds for moved walls with the best F1."""
    config = ComparisonConfig(moved=0.03, sure=1.0)
    runs = [(compare_with_plan(case.plan, case.grid, config).changes, case.truth) for case in cases]
    best, best_score = (0.07, 3.0), -1.0
    for moved, sure in itertools.product(
        (0.04, 0.05, 0.06, 0.07, 0.08, 0.1), (1.5, 2.0, 2.5, 3.0, 3.5)
    ):
        hits = misses = false = 0
        for changes, truth in runs:
            walls = [c for c in kept(changes, moved, sure) if c.kind == "wall_moved"]
            true_walls = [t for t in truth if t.kind == "wall_moved"]
            hit = sum(any(finds(c, t) for c in walls) for t in true_walls)
            hits, misses = hits + hit, misses + len(true_walls) - hit
            false += sum(is_false(c, truth) for c in walls)
        score = 2 * hits / (2 * hits + misses + false)
        found = f"{hits} found, {misses} missed, {false} false, F1 {score:.3f}"
        print(f"  moved {moved:.2f} m, {sure:.1f} standard errors: {found}")
        if score > best_score:
            best, best_score = (moved, sure), score
    return best


def share(hits: int, total: int) -> str:
    if not total:
        return "-"
    interval = wilson_interval(hits, total)
    return f"{hits}/{total} = {hits / total:.2f} [{interval.low:.2f}, {interval.high:.2f}]"


def table(cases: list[Case], config: ComparisonConfig) -> list[dict[str, str]]:
    """Recall by kind and size, and precision by kind and size as reported."""
    begun = time.process_time()
    runs = [(compare_with_plan(case.plan, case.grid, config), case.truth) for case in cases]
    seconds = (time.process_time() - begun) / len(cases)
    registered, loops = (
        sum(run.is_confident for run, _ in runs),
        seconds / Yardsticks.measure(1).loop,
    )
    print(
        f"  {registered} of {len(runs)} registered, {loops:.1f} loops or {seconds:.2f} CPU s each"
    )
    rows = []
    sizes = [("wall_moved", low, high) for low, high in BINS]
    for kind, low, high in [
        *sizes,
        *((k, 0.0, 9.0) for k in ("wall_missing", "wall_extra", "door_moved", "door_blocked")),
    ]:
        truths = [
            (t, run)
            for run, truth in runs
            for t in truth
            if t.kind == kind and low <= abs(t.offset) < high
        ]
        found = [t for t, run in truths if any(finds(c, t) for c in run.changes)]
        noticed = [t for t, run in truths if any(not is_false(c, [t]) for c in run.changes)]
        errors = [
            100.0 * min(offset_error(c, t) for c in run.changes if finds(c, t))
            for t, run in truths if kind == "wall_moved" and any(finds(c, t) for c in run.changes)
        ]  # fmt: skip
        kinds = {
            "wall_missing": ("wall_missing", "opening_new"),
            "door_moved": ("door_moved", "door_width"),
        }.get(kind, (kind,))
        reported = [
            (c, truth) for run, truth in runs for c in run.changes
            if c.kind in kinds and (kind != "wall_moved" or low <= abs(c.offset or 0.0) < high)
        ]  # fmt: skip
        right = sum(not is_false(c, truth) for c, truth in reported)
        rows.append(
            {
                "change": kind.replace("_", " ")
                + (f" {100 * low:.0f}-{100 * high:.0f} cm" if kind == "wall_moved" else ""),
                "recall, of this kind": share(len(found), len(truths)),
                "recall, noticed": share(len(noticed), len(truths)),
                "precision": share(right, len(reported)),
                "offset error, median cm": f"{np.median(errors):.1f}" if errors else "-",
            }
        )
    unchanged = [sum(is_false(c, truth) for c in run.changes) for run, truth in runs]
    print(f"  false changes a map: {np.mean(unchanged):.2f}")
    return rows


def different_buildings(cases: list[Case]) -> str:
    """Number of maps that are matched with the plan of another building."""
    wrong = [
        compare_with_plan(cases[(i + 1) % len(cases)].plan, case.grid).is_confident
        for i, case in enumerate(cases)
    ]
    return f"{share(sum(wrong), len(wrong))} maps are taken for another building's"


def house_of_turtlebot3(folder: Path, work: Path) -> list[dict[str, str]]:
    """The plan without furniture against people's maps: all but furniture should be as planned."""
    walls = json.loads((folder / "cad.json").read_text())["walls"]
    rings = [[[*ring, ring[0]]] for ring in walls]
    drawing = work / "tb3_house.geojson"
    drawing.parent.mkdir(parents=True, exist_ok=True)
    drawing.write_text(json.dumps({"type": "MultiPolygon", "coordinates": rings}))
    drawn = open_plans(drawing).load("tb3_house")
    rows = []
    for run in sorted((folder / "runs").iterdir()):
        found = compare_with_plan(drawn, read_map(run / "slam.yaml").grid)
        kinds = [change.kind for change in found.changes]
        rows.append(
            {
                "map": run.name,
                "registered": str(found.is_confident),
                "walls in view that are there": f"{found.registration.explained:.2f}",
                "walls present": str(sum(wall.kind == "wall_present" for wall in found.walls)),
                **{
                    kind: str(kinds.count(kind))
                    for kind in ("wall_moved", "wall_missing", "wall_extra", "opening_new")
                },
            }
        )
    return rows


def main(arguments: Arguments) -> None:
    if arguments.tb3_house:
        rows = house_of_turtlebot3(arguments.tb3_house, arguments.work)
        print_and_save(
            "plan_comparison/tb3_house",
            "TurtleBot3's house: people's maps against its walls",
            rows,
            list(rows[0]),
            MODULES,
        )
    cases = explored(arguments)
    half = len(cases) // 2
    moved, sure = choose_threshold(cases[:half])
    print(f"chosen on {half} maps: moved {moved} m, {sure} standard errors")
    config = ComparisonConfig()
    name = "furnished" if arguments.furniture else "empty"
    for part, some in (("chosen on", cases[:half]), ("held out", cases[half:])):
        rows = table(some, config)
        print_and_save(
            f"plan_comparison/{name}_{part.replace(' ', '_')}",
            f"{len(some)} maps, {part}, {name}",
            rows,
            list(rows[0]),
            MODULES,
        )
    print(different_buildings(cases[half:]))


if __name__ == "__main__":
    main(tyro.cli(Arguments))
