"""``slamgym cad compare``: a robot's map against a floor plan."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from slamgym.cad.plan_formats import PLAN_FILES, plan_format
from slamgym.commands.frame import Out, require_folder, require_plan, show_table
from slamgym.commands.settings import AllSettings, SettingsOptions
from slamgym.core.config import Arguments, Positive
from slamgym.core.errors import InputFileError
from slamgym.core.files import write_text
from slamgym.core.progress import say, tell
from slamgym.drawing.settings import ComparisonConfig

if TYPE_CHECKING:
    from slamgym.cad.floorplan import FloorPlan
    from slamgym.drawing.comparison.records import PlanComparison, PlanFinding

EXIT_DIFFERENT = 1
"""Plan and map are of different buildings, it seems."""


class CompareArguments(Arguments):
    """Compare a robot's map with a floor plan: walls moved, missing and extra, doors, rooms not yet explored.

    Where the map lies on the plan is found by itself. Exit status 1 if the two don't fit together.
    """

    plan: Annotated[str, tyro.conf.Positional, tyro.conf.arg(help=f"The plan: {PLAN_FILES}.")]
    map: tyro.conf.Positional[Path]
    """The map: a ROS yaml or its folder, Valetudo's JSON or PNG, or a picture (--resolution)."""
    out: Out
    """Folder for comparison.html, comparison.json, comparison.csv and comparison.png."""
    resolution: Positive | None = None
    """Metres of a pixel of a map that doesn't say it."""
    storey: str | None = None
    """Which plan of a file with several, an IFC model's storey above all; the first by default."""
    layers: tuple[str, ...] = ()
    """Layers of a DXF drawing's walls, where their names don't say it."""
    settings: AllSettings = SettingsOptions()
    """Limits from which on a difference counts."""


def main(arguments: CompareArguments, typed: str) -> int:
    """Run the command.

    Returns:
        The exit code: 0, or 1 if plan and map are of different buildings.

    Raises:
        SlamgymError: If one of them can't be read.
    """
    from slamgym.drawing.comparison.compare import compare_with_plan
    from slamgym.drawing.comparison.picture import draw_comparison
    from slamgym.drawing.comparison.records import write_comparison
    from slamgym.drawing.comparison.report import format_comparison
    from slamgym.interop.map_files import MAP_SUFFIXES, read_map
    from slamgym.viz.canvas import write_picture

    require_folder(arguments.out)
    if plan_format(arguments.map.name) and arguments.map.suffix.lower() not in MAP_SUFFIXES:
        raise InputFileError(
            arguments.map, f"is a floor plan and no map; name it before {arguments.plan}"
        )
    config = arguments.settings.configured(ComparisonConfig(), {})
    plan = _read_plan(arguments)
    robot_map = read_map(arguments.map, arguments.resolution)
    notes = (*plan.doubts, *robot_map.doubts)
    found = compare_with_plan(plan, robot_map.grid, config, str(arguments.map), notes)
    write_picture(arguments.out / "comparison.png", draw_comparison(found, plan, robot_map.grid))
    page = format_comparison(found, plan, robot_map.grid, typed)
    write_text(arguments.out / "comparison.html", page)
    write_comparison(arguments.out, found)
    _report(found, arguments.out)
    return 0 if found.is_confident else EXIT_DIFFERENT


def _read_plan(arguments: CompareArguments) -> FloorPlan:
    """The plan, with what is doubtful about it."""
    from slamgym.cad.sources import open_drawing

    source = open_drawing(arguments.plan, arguments.layers)
    ids = list(source.ids)
    wanted = arguments.storey or ids[0]
    fitting = (plan_id for plan_id in ids if plan_id.endswith(f"-{wanted}"))
    plan_id = wanted if wanted in ids else next(fitting, wanted)
    require_plan(arguments.plan, plan_id, ids)
    return source.load(plan_id)


def _report(found: PlanComparison, folder: Path) -> None:
    """Print a table."""
    for doubt in found.doubts:
        say(f"slamgym: doubt: {doubt}")
    if found.is_confident:
        share = found.registration.explained
        tell(
            f"{share:.0%} of the plan's walls in view are in the map; {len(found.changes)} changes"
        )
        rows = [_row(change) for change in found.changes]
        if rows:
            show_table(
                ("change", "at x, y [m]", "length [m]", "by [cm]", "+-", "with drift", "of"), rows
            )
    tell(f"{folder / 'comparison.html'}")


def _row(change: PlanFinding) -> list[str]:
    x0, y0, x1, y1 = change.line
    x = 0.5 * (x0 + x1)
    y = 0.5 * (y0 + y1)
    lengths = change.offset, change.error, change.raw_offset
    moved = ["" if length is None else f"{100.0 * length:.0f}" for length in lengths]
    return [
        change.kind.replace("_", " "),
        f"{x:.1f}, {y:.1f}",
        f"{change.length:.2f}",
        *moved,
        change.what,
    ]
