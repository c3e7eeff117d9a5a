"""Pairs of drives whose maps are to be merged, and such as must not be: simulated, mapped once, kept on disk."""

import dataclasses
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely
from drives import Conditions, drive, kept_drive
from shapely.affinity import translate

from slamgym.cad import FloorPlan, PlanGeneratorConfig, generate_plan, generator
from slamgym.core.geometry import compose
from slamgym.core.types import FloatArray, Pose2D, Trajectory
from slamgym.interop import Log, LogRecord
from slamgym.interop.tum import read_tum, write_tum
from slamgym.metrics.trajectory import align_se2
from slamgym.sim import ClutterConfig
from slamgym.slam import SlamConfig
from slamgym.slam.graph.graph_files import GRAPH, read_graph, write_graph
from slamgym.slam.graph.map_graph import MapGraph
from slamgym.slam.replay import replay

FIRST = 20_000
"""Number of the first building."""
OFFICE_EVERY = 4
"""Every so many buildings one is an office of 150 to 700 m2; the others are homes."""
MINUTES = (1.5, 2.5, 4.0, 7.0)
"""Length of a drive, by chance."""
LASERS = ((3.5, 180), (3.5, 360), (8.0, 360))
"""Range [m] and view [deg] of the second drive's laser, by chance; the first one has the first."""
CHOSEN = 22
"""So many of the first buildings chose the thresholds."""
KINDS = ("first", "second", "mirrored", "storey", "furnished", "furnished anew")
"""Drives of a building: two in it, one in its mirror image, one where rooms are the same and doors are others, and two
with furniture, each time with other pieces. Every fourth building has the last two."""
ALIKE = 0.85
"""A storey covers so much of the other's floor (intersection over union)."""
STOREYS_TRIED = 50
FURNITURE = 0.3
"""Share of the usual furniture, in furnished drives."""


class MappedDrive(NamedTuple):
    """A drive's graph, and where its nodes truly were."""

    graph: MapGraph
    truth: Trajectory  # one pose a node, in the frame of the plan
    plan: FloorPlan

    @property
    def frame(self) -> Pose2D:
        """Pose of the map's frame in the plan's that fits the whole path best."""
        return align_se2(self.graph.poses[:, :2], self.truth.poses[:, :2])


def building(number: int) -> tuple[str, PlanGeneratorConfig]:
    """Kind of a building, and the settings that make it."""
    is_office = number % OFFICE_EVERY == OFFICE_EVERY - 1
    kind = "office" if is_office else "home"
    return kind, PlanGeneratorConfig(kind=kind)  # type: ignore[arg-type]


def mapped_drives(number: int, cache: Path, kinds: Sequence[str] = KINDS) -> dict[str, MappedDrive]:
    """Drives of a building, from the cache, or simulated, mapped and put there."""
    kind, config = building(number)
    plan = generate_plan(number, config)
    plans = (plan, plan, mirrored(plan), None, plan, plan)
    rng = np.random.default_rng(number)
    found = {}
    for index, (name, own) in enumerate(zip(KINDS, plans, strict=True)):
        minutes = float(rng.choice(MINUTES))
        reach, view = LASERS[0] if index == 0 else LASERS[int(rng.integers(len(LASERS)))]
        if index == 0 and number % (2 * OFFICE_EVERY) == 2 * OFFICE_EVERY - 1:
            reach, view = LASERS[2]
        heading = float(rng.uniform(-np.pi, np.pi))
        if name not in kinds or not is_driven(number, name):
            continue
        building_of = storey(number, config, plan) if name == "storey" else own
        if building_of is None:
            continue
        folder = cache / f"{kind}_{number}" / name
        if not (folder / GRAPH).exists():
            conditions = Conditions(minutes=minutes, range_max=reach, view_deg=view)
            if "furnished" in name:
                conditions = Conditions(minutes=4.0, view_deg=360)
            make(building_of, number + 100_000 * index, conditions, heading, folder)
        found[name] = MappedDrive(read_graph(folder), read_tum(folder / "truth.tum"), building_of)
    return found


def is_driven(number: int, name: str) -> bool:
    """Whether a building has a drive of this kind."""
    return "furnished" not in name or number % OFFICE_EVERY == 0


def make(plan: FloorPlan, seed: int, conditions: Conditions, heading: float, folder: Path) -> None:
    """Drive, turn the odometry's frame by a heading [rad], map, and write."""
    drives = folder.parents[1] / "drives"
    if "furnished" in folder.name:
        episode = conditions.episode()
        env = dataclasses.replace(episode.env, clutter=ClutterConfig(furniture=FURNITURE))
        config_of = dataclasses.replace(episode, env=env)
        made = kept_drive(drives / f"{plan.id}-{seed}-{folder.name}.npz", plan, seed, config_of)
    else:
        made = drive(plan, seed, conditions, drives)
    turn = Pose2D(0.0, 0.0, heading)
    records = [
        LogRecord(record.stamp, compose(turn, record.odometry), record.scan) for record in made.log
    ]
    log = Log(made.log.source, records, made.log.geometry)
    config = SlamConfig.for_log(log.geometry.range_max, log.geometry.num_beams)
    result = replay(log, config, np.random.default_rng(0))
    assert result.graph is not None
    start = plan.segments()[0, :2] - made.walls[0, :2]
    nodes = np.searchsorted(made.truth.stamps, result.processed.stamps)
    truth = made.truth.poses[nodes] + np.append(start, 0.0)
    folder.mkdir(parents=True, exist_ok=True)
    write_tum(folder / "truth.tum", Trajectory(result.processed.stamps, truth))
    write_graph(folder, result.graph)


def mirrored(plan: FloorPlan) -> FloorPlan:
    """The mirror image."""
    shape = shapely.transform(plan.free_space, lambda points: points * [-1.0, 1.0]).reverse()
    return dataclasses.replace(plan, id=f"{plan.id}m", free_space=shape, rooms=(), doors=())


def storey(number: int, config: PlanGeneratorConfig, plan: FloorPlan) -> FloorPlan | None:
    """Another storey: the same rooms with other doors, bays and pillars; None if none comes out alike."""
    rng = np.random.default_rng(number)
    is_office = config.kind == "office"
    area = generator._draw_area(is_office, config, rng)
    rooms = generator.rooms_for_area(area, rng)
    others = np.random.default_rng(number + 1_000_000)
    name = f"storey2_{config.kind}_{number}"
    own = None
    while own is None:
        cells = (
            generator.lay_out_office(area, rng)
            if is_office
            else generator.lay_out_home(area, rooms, rng)
        )
        own = generator._build("", cells, config.loops, generator._OPEN_PLAN[config.kind], rng)
    for _ in range(STOREYS_TRIED):
        other = generator._build(
            name, cells, config.loops, generator._OPEN_PLAN[config.kind], others
        )
        laid = None if other is None else _laid_like(other, plan)
        if laid is not None:
            return laid
    return None


def _laid_like(other: FloorPlan, plan: FloorPlan) -> FloorPlan | None:
    """A floor turned and mirrored as another one is; None if they don't cover each other."""
    shapes = [_on_corner(shape, plan.bounds) for shape in _images(other.free_space)]
    shares = [
        shape.intersection(plan.free_space).area / shape.union(plan.free_space).area
        for shape in shapes
    ]
    best = int(np.argmax(shares))
    if shares[best] < ALIKE:
        return None
    shape = shapely.geometry.polygon.orient(shapes[best])
    return dataclasses.replace(other, free_space=shape, rooms=(), doors=())


def _images(shape: shapely.Polygon) -> Iterator[shapely.Polygon]:
    for swapped in (False, True):
        for signs in ((1, 1), (1, -1), (-1, 1), (-1, -1)):

            def move(
                points: FloatArray, swapped: bool = swapped, signs: tuple[int, int] = signs
            ) -> FloatArray:
                return (points[:, ::-1] if swapped else points) * signs

            yield shapely.transform(shape, move)


def _on_corner(shape: shapely.Polygon, bounds: tuple[float, ...]) -> shapely.Polygon:
    x, y = shape.bounds[:2]
    return translate(shape, bounds[0] - x, bounds[1] - y)
