"""``slamgym plans``: fetch, list, check, draw and write floor plans."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from slamgym.core.config import Arguments, Count, Within
from slamgym.core.errors import ConfigError
from slamgym.core.files import spare_inputs
from slamgym.core.names import as_file_name, is_file_name
from slamgym.core.progress import counted, say, tell
from slamgym.envs.config import ObservationConfig
from slamgym.sim import RobotConfig

if TYPE_CHECKING:
    from slamgym.cad.floorplan import FloorPlan
    from slamgym.cad.plan_filter import Rejections
    from slamgym.cad.plan_index import PlanSource

MAX_NAMED = 10
"""So many rejected plans are named on the terminal; the file names them all."""


class _Selection(Arguments):
    """Which plans."""

    plans: tyro.conf.Positional[str] = "bundled"
    """``bundled``; ``procedural`` or ``procedural:SEED``; a HouseExpo file, a folder or a .tar.gz of them; a
    ROS map's yaml; a picture and its metres per pixel, as in plan.png@0.05."""
    ids: Path | None = None
    """A file with one plan id a line: take only these plans."""
    count: Count | None = None
    """Take only the first so many plans."""
    robot_radius: float = RobotConfig.radius
    """The robot must be able to enter the rooms; the default holds a TurtleBot3 Waffle Pi [m]."""
    max_extent: Annotated[float, Within(gt=0.0, infinite=True)] = ObservationConfig().largest_extent
    """Longest side that a plan may have [m]; the default is the largest map that an explorer is shown."""


class ListPlans(_Selection):
    """Print id, area, rooms, size, corners, holes and doors of every usable plan."""


class CheckPlans(_Selection):
    """Report which plans can be explored, and what is wrong with the others."""

    rejected: Path = Path("rejected.jsonl")
    """Where the plans that can't be explored are written, one JSON object a line."""


class DrawPlans(_Selection):
    """Draw plans on one picture: rooms coloured by use, doors marked, a scale bar each."""

    out: Path = Path("plans.png")
    """The picture."""
    columns: Count = 6
    """Plans in a row."""
    size: Annotated[int, Within(ge=64)] = 360
    """Width of one plan [pixels]."""


class WritePlans(_Selection):
    """Write usable plans as HouseExpo files, e.g. to keep generated ones or to convert a map."""

    out: Path = Path("plans")
    """The folder; made if it is missing. The plans left out are listed in its ``rejected.jsonl``."""


class FetchPlans(Arguments):
    """Download a public archive of floor plans, unless it is there."""

    archive: tyro.conf.Positional[Literal["houseexpo"]] = "houseexpo"
    """Which one."""
    out: Path | None = None
    """Where it goes; by default under its own name, json.tar.gz, into this folder."""
    url: str | None = None
    """Another address of the same file, such as a mirror's."""


_Arguments = (
    Annotated[ListPlans, tyro.conf.subcommand("list")]
    | Annotated[CheckPlans, tyro.conf.subcommand("check")]
    | Annotated[DrawPlans, tyro.conf.subcommand("draw")]
    | Annotated[WritePlans, tyro.conf.subcommand("write")]
    | Annotated[FetchPlans, tyro.conf.subcommand("fetch")]
)

MAX_DRAWN = 60
"""A sheet of more plans needs an explicit ``--count``."""


def main(argv: list[str]) -> int:
    """Run the command.

    Returns:
        The exit code: 1 if ``check`` found unusable plans, else 0.

    Raises:
        SlamgymError: If the plans or the output can't be opened.
    """
    arguments = tyro.cli(
        _Arguments,
        args=argv,
        prog="slamgym plans",
        description="Fetch, list, check, draw and write floor plans.",
    )
    if isinstance(arguments, FetchPlans):
        _fetch(arguments)
        return 0
    from slamgym.cad.plan_filter import Rejections
    from slamgym.cad.sources import open_plans

    source = open_plans(arguments.plans, ids_file=arguments.ids)
    rejections = Rejections()
    if isinstance(arguments, ListPlans):
        _list(_usable(arguments, source, rejections))
        _report(rejections)
    elif isinstance(arguments, CheckPlans):
        return _check(arguments, source, rejections)
    elif isinstance(arguments, DrawPlans):
        _draw(arguments, source, rejections)
    else:
        _write(arguments, source, rejections)
    return 0


def _fetch(arguments: FetchPlans) -> None:
    from rich.console import Console
    from rich.progress import Progress

    from slamgym.cad.archives import HOUSEEXPO_LICENCE, HOUSEEXPO_URL, fetch_houseexpo

    sys.stdout.write(HOUSEEXPO_LICENCE + "\n")
    sys.stdout.flush()
    path = arguments.out or Path(Path(HOUSEEXPO_URL).name)
    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(path.name, total=None)
        count = fetch_houseexpo(
            path,
            arguments.url,
            lambda done, total: progress.update(task, completed=done, total=total or None),
        )
    tell(f"{path}: {counted(count, 'plan')}, SHA-256 in {path.name}.sha256; use it as --plans {path}")


def _usable(arguments: _Selection, source: PlanSource, rejections: Rejections) -> Iterator[FloorPlan]:
    """The chosen plans that pass the check, with a progress bar on a terminal."""
    from rich.console import Console
    from rich.progress import track

    from slamgym.cad.plan_filter import usable_plans

    ids: Sequence[str] = source.ids[: arguments.count]
    console = Console(stderr=True)
    shown = track(ids, "plans", console=console, transient=True, disable=not console.is_terminal)
    return usable_plans(source, shown, rejections, arguments.robot_radius, arguments.max_extent)


def _list(plans: Iterator[FloorPlan]) -> None:
    tell(f"{'id':32} {'area m2':>8} {'rooms':>5} {'size m':>13} {'corners':>7} {'holes':>5} {'doors':>5}")
    for plan in plans:
        min_x, min_y, max_x, max_y = plan.bounds
        size = f"{max_x - min_x:.1f} x {max_y - min_y:.1f}"
        tell(
            f"{plan.id:32} {plan.area:8.1f} {len(plan.rooms):5d} {size:>13} {plan.num_vertices:7d} "
            f"{len(plan.free_space.interiors):5d} {len(plan.doors):5d}"
        )


def _check(arguments: CheckPlans, source: PlanSource, rejections: Rejections) -> int:
    usable = sum(1 for _ in _usable(arguments, source, rejections))
    tell(f"{usable} of {counted(usable + len(rejections), 'plan')} can be explored.")
    rejections.write(arguments.rejected)
    _report(rejections, arguments.rejected)
    return 1 if len(rejections) else 0


def _draw(arguments: DrawPlans, source: PlanSource, rejections: Rejections) -> None:
    from slamgym.viz.canvas import write_picture
    from slamgym.viz.plan_pictures import draw_plan_sheet

    if arguments.count is None and len(source) > MAX_DRAWN:
        raise ConfigError(f"{len(source)} plans are too many for one picture; add --count 24, for example")
    plans = list(_usable(arguments, source, rejections))
    spare_inputs([Path(plan.source) for plan in plans], arguments.out)
    if plans:
        write_picture(arguments.out, draw_plan_sheet(plans, arguments.columns, arguments.size))
        tell(f"{counted(len(plans), 'plan')} drawn: {arguments.out}")
    rejections.write(arguments.out.with_name("rejected.jsonl"))
    _report(rejections, arguments.out.with_name("rejected.jsonl"))


def _write(arguments: WritePlans, source: PlanSource, rejections: Rejections) -> None:
    from slamgym.cad.houseexpo import write_houseexpo

    written = 0
    for plan in _usable(arguments, source, rejections):
        name = plan.id if is_file_name(plan.id) else as_file_name(f"plan-{written}-{plan.id}")
        spare_inputs([Path(plan.source)], arguments.out / f"{name}.json")
        write_houseexpo(arguments.out / f"{name}.json", plan)
        written += 1
    tell(f"{counted(written, 'plan')} written: {arguments.out}")
    rejections.write(arguments.out / "rejected.jsonl")
    _report(rejections, arguments.out / "rejected.jsonl")


def _report(rejections: Rejections, path: Path | None = None) -> None:
    """Say which plans were left out and why."""
    if not len(rejections):
        return
    say(f"Left out {counted(len(rejections), 'plan')}" + (f", see {path}:" if path else ":"))
    for index, entry in enumerate(rejections):
        if index == MAX_NAMED:
            say(f"  and {len(rejections) - MAX_NAMED} more")
            break
        say(f"  {entry.source}: {entry.reason}")
