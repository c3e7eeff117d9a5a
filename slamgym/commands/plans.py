"""``slamgym plans``: fetch, list, check, draw and write floor plans."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from slamgym.cad.plan_formats import PLANS_HELP
from slamgym.commands.frame import MaybeOut, Out
from slamgym.core.config import Arguments, Count
from slamgym.core.errors import ConfigError, InputFileError, PlanError
from slamgym.core.files import spare_inputs, write_text
from slamgym.core.names import as_file_name, is_file_name
from slamgym.core.progress import counted, say, tell

if TYPE_CHECKING:
    from slamgym.cad.floorplan import FloorPlan

_Rejections = list[dict[str, str]]
"""Name, source and fault of each plan that can't be explored."""
MAX_NAMED = 10
"""So many rejected plans are named on the terminal; the file names them all."""


class _Selection(Arguments):
    """Which plans."""

    plans: Annotated[str, tyro.conf.Positional, tyro.conf.arg(help=PLANS_HELP)] = "bundled"
    ids: Path | None = None
    """A file with one plan id a line: take only these plans."""
    layers: tuple[str, ...] = ()
    """Layers of a DXF drawing's walls, where their names don't say it."""
    count: Count | None = None
    """Take only the first so many plans."""


class ListPlans(_Selection):
    """Print id, area, rooms, size, corners, holes and doors of every usable plan."""


class CheckPlans(_Selection):
    """Report which plans can be explored, and what is wrong with the others."""

    rejected: Path = Path("rejected.jsonl")
    """Where the plans that can't be explored are written, one JSON object a line."""


class DrawPlans(_Selection):
    """Draw plans on one picture: rooms coloured by use, doors marked, a scale bar each."""

    out: Out = Path("plans.png")
    """The picture, .png or .jpg."""


class WritePlans(_Selection):
    """Write usable plans as HouseExpo files, e.g. to keep generated ones or to convert a map."""

    out: Out = Path("plans")
    """The folder; made if it is missing. The plans left out are listed in its ``rejected.jsonl``."""


class FetchPlans(Arguments):
    """Download a public archive of floor plans, unless it is there."""

    archive: tyro.conf.Positional[Literal["houseexpo"]] = "houseexpo"
    """Which one."""
    out: MaybeOut = None
    """Where it goes; by default under its own name, json.tar.gz, into this folder."""
    sha256: str | None = None
    """What the archive must have: of a copy that you know."""


MAX_DRAWN = 60
"""A sheet of more plans needs an explicit ``--count``."""


def fetch_command(arguments: FetchPlans) -> None:
    """Run ``slamgym plans fetch``."""
    from rich.console import Console
    from rich.progress import Progress

    from slamgym.cad.archives import HOUSEEXPO_LICENCE, HOUSEEXPO_URL, fetch_houseexpo

    sys.stdout.write(HOUSEEXPO_LICENCE + "\n")
    sys.stdout.flush()
    path = arguments.out or Path(Path(HOUSEEXPO_URL).name)
    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(path.name, total=None)

        def show(done: int, total: int) -> None:
            if total and progress.tasks[0].total is None:
                say(f"{path.name}: {total / 1e6:.0f} MB to download")
            progress.update(task, completed=done, total=total or None)

        count = fetch_houseexpo(path, advance=show, sha256=arguments.sha256)
    tell(
        f"{path}: {counted(count, 'plan')}, SHA-256 in {path.name}.sha256; use it as --plans {path}"
    )


def _usable(arguments: _Selection) -> tuple[Iterator[FloorPlan], _Rejections]:
    """The chosen plans that `generate` can explore, with a progress bar on a terminal, and a list of the others."""
    from rich.console import Console
    from rich.progress import track

    from slamgym.cad.floorplan import check_plan
    from slamgym.cad.sources import open_plans
    from slamgym.envs.config import ObservationConfig
    from slamgym.sim import RobotConfig

    source = open_plans(arguments.plans, ids_file=arguments.ids, layers=arguments.layers)
    ids: Sequence[str] = source.ids[: arguments.count]
    if isinstance(arguments, DrawPlans) and len(ids) > MAX_DRAWN and arguments.count is None:
        raise ConfigError(
            f"{len(ids)} plans are too many for one picture; add --count 24, for example"
        )
    console = Console(stderr=True)
    radius = RobotConfig().radius
    extent = ObservationConfig().largest_extent
    rejections: _Rejections = []

    def usable() -> Iterator[FloorPlan]:
        for plan_id in track(
            ids, "plans", console=console, transient=True, disable=not console.is_terminal
        ):
            try:
                plan = source.load(plan_id)
                check_plan(plan, radius, extent)
            except PlanError as error:
                rejections.append({"plan": plan_id, "source": error.path, "reason": error.reason})
            else:
                yield plan

    return usable(), rejections


def list_command(arguments: ListPlans) -> int:
    """Run ``slamgym plans list``; returns 1 if no plan can be explored."""
    plans, rejections = _usable(arguments)
    tell(
        f"{'id':32} {'area m2':>8} {'rooms':>5} {'size m':>13} {'corners':>7} {'holes':>5} {'doors':>5}"
    )
    listed = 0
    for plan in plans:
        listed += 1
        min_x, min_y, max_x, max_y = plan.bounds
        size = f"{max_x - min_x:.1f} x {max_y - min_y:.1f}"
        tell(
            f"{plan.id:32} {plan.area:8.1f} {len(plan.rooms):5d} {size:>13} {plan.num_vertices:7d} "
            f"{len(plan.free_space.interiors):5d} {len(plan.doors):5d}"
        )
    _report(rejections)
    return int(listed == 0)


def check_command(arguments: CheckPlans) -> int:
    """Run ``slamgym plans check``; returns 1 if there are plans that can't be explored."""
    plans, rejections = _usable(arguments)
    usable = sum(1 for _ in plans)
    tell(f"{usable} of {counted(usable + len(rejections), 'plan')} can be explored.")
    _report(rejections, arguments.rejected)
    return 1 if rejections else 0


def draw_command(arguments: DrawPlans) -> int:
    """Run ``slamgym plans draw``; returns 1 if no plan could be drawn."""
    from slamgym.viz.canvas import write_picture
    from slamgym.viz.plan_pictures import draw_plan_sheet

    found, rejections = _usable(arguments)
    plans = list(found)
    spare_inputs([Path(plan.source) for plan in plans], arguments.out)
    if arguments.out.suffix.lower() not in (".png", ".jpg", ".jpeg"):
        raise InputFileError(arguments.out, "would be no picture; end its name in .png or .jpg")
    if plans:
        write_picture(arguments.out, draw_plan_sheet(plans))
        tell(f"{counted(len(plans), 'plan')} drawn: {arguments.out}")
    _report(rejections, arguments.out.with_name("rejected.jsonl"))
    return int(not plans)


def write_command(arguments: WritePlans) -> int:
    """Run ``slamgym plans write``; returns 1 if no plan could be written."""
    from slamgym.cad.houseexpo import write_houseexpo

    plans, rejections = _usable(arguments)
    written = 0
    for plan in plans:
        name = plan.id if is_file_name(plan.id) else as_file_name(f"plan-{written}-{plan.id}")
        spare_inputs([Path(plan.source)], arguments.out / f"{name}.json")
        write_houseexpo(arguments.out / f"{name}.json", plan)
        written += 1
    tell(f"{counted(written, 'plan')} written: {arguments.out}")
    _report(rejections, arguments.out / "rejected.jsonl")
    return int(written == 0)


def _report(rejections: _Rejections, path: Path | None = None) -> None:
    """Say which plans were left out and why, and write them to a file, one JSON object a line."""
    if not rejections:
        return
    if path:
        write_text(path, "".join(json.dumps(entry) + "\n" for entry in rejections))
    say(f"Left out {counted(len(rejections), 'plan')}" + (f", see {path}:" if path else ":"))
    for entry in rejections[:MAX_NAMED]:
        say(f"  {entry['source']}: {entry['reason']}")
    if len(rejections) > MAX_NAMED:
        say(f"  and {len(rejections) - MAX_NAMED} more")
