"""Draw the explorations of slamgym-bench and freeze them: agents/bench/frozen.

    python benchmarks/exploring/freeze_bench.py json.tar.gz polimi.jsonl.xz

It was run once, for version 1. It stays here to show how the list came about, and refuses to write over one that is
there.

Homes are HouseExpo plans of the split ``test``, so no weights that come with the package, no promise and no rule were
fitted on them, and none looks like a plan of the other splits or like another home of the benchmark. Offices and
schools are those of Luperto and Amigoni with loops, the smaller ones in ``loops`` and the larger ones in ``large``;
generated offices with loops fill both up to fifty.
"""

import dataclasses
import io
import json
import lzma
import tarfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import tyro

from slamgym.agents.bench.manifest import (
    BENCH,
    BENCH_VERSION,
    MANIFEST,
    SHIPPED_PLANS,
    Track,
    TrackBuilding,
    furniture_of,
    outline_hash,
)
from slamgym.agents.plan_splits import ids_of
from slamgym.agents.rl.train_config import FURNISHED
from slamgym.cad import FloorPlan, PlanSource, check_plan, open_plans
from slamgym.cad.generator import PlanGeneratorConfig, generate_plan
from slamgym.cad.houseexpo import format_houseexpo, parse_houseexpo
from slamgym.cad.plan_filter import passes
from slamgym.core.config import to_dict
from slamgym.core.errors import PlanError
from slamgym.core.names import as_file_name, exploration_seed, shuffled
from slamgym.dataset.curate.near_duplicates import near_duplicates, plan_print
from slamgym.envs import ExploreEnv
from slamgym.envs.episode import fitted_env
from slamgym.sim import ClutterConfig, RobotConfig

HOMES = 200
"""Explorations of the track ``homes``."""
VARIANTS = 50
"""Explorations of furnished homes, and of homes with people."""
OFFICES = 50
"""Explorations of the track ``loops``, and of ``large``."""
SMALL_REAL = 20
"""Schools and offices that were really built on the track ``loops``; the others are generated."""
LARGE_REAL = 40
"""And on the track ``large``, at most."""
LARGEST = 4500.0
"""Larger plans are left out [m2]; an exploration takes some minutes of CPU."""
SEED = 2026
"""Of all draws."""
PEOPLED = dataclasses.replace(FURNISHED, people=2)
"""Clutter of the track ``people``."""


@dataclass(frozen=True)
class Arguments:
    """Draw and freeze."""

    houseexpo: tyro.conf.Positional[str]
    """HouseExpo's training plans."""
    polimi: tyro.conf.Positional[str]
    """Schools and offices."""


def main() -> None:
    arguments = tyro.cli(Arguments)
    if MANIFEST.exists():
        raise SystemExit(f"{MANIFEST} is frozen; a new list is a new version")
    real = draw_real(open_plans(arguments.polimi))
    loops = [*real[:SMALL_REAL], *offices("office", OFFICES - SMALL_REAL, (150.0, 700.0))]
    larger = real[SMALL_REAL : SMALL_REAL + LARGE_REAL]
    large = [*larger, *offices("large_office", OFFICES - len(larger), (800.0, 1600.0))]
    shipped = [*loops, *large]
    write_archive(shipped)
    homes = draw_homes(open_plans(arguments.houseexpo))
    tracks = [
        freeze(Track("homes", "homes", False, ClutterConfig(), ()), homes),
        freeze(
            Track("loops", "offices and schools with loops", True, ClutterConfig(), ()),
            shipped[:OFFICES],
        ),
        freeze(
            Track("large", "large schools and offices with loops", True, ClutterConfig(), ()),
            shipped[OFFICES:],
        ),
        freeze(
            Track("furnished", "homes with furniture and doors", False, FURNISHED, ()),
            homes[:VARIANTS],
        ),
        freeze(
            Track("people", "the same with two people who walk about", False, PEOPLED, ()),
            homes[:VARIANTS],
        ),
    ]
    write_manifest(tracks)


def draw_homes(source: PlanSource) -> list[FloorPlan]:
    """Held-out plans worth exploring whose files need no repair, and which look like no other plan."""
    radius = RobotConfig().radius
    plans: list[FloorPlan] = []
    for plan_id in shuffled(ids_of(source.ids, "test"), SEED):
        try:
            plan = source.load(plan_id)
            check_plan(plan, radius)
        except PlanError:
            continue
        if passes(plan, "useful") and is_as_drawn(plan):
            plans.append(plan)
        if len(plans) == 2 * HOMES:
            break
    others = [
        plan
        for split in ("train", "validation")
        for plan in useful(source, ids_of(source.ids, split))
    ]
    print(f"{len(plans)} candidates against {len(others)} others")
    prints = [plan_print(plan) for plan in (*plans, *others)]
    groups = near_duplicates(np.stack(prints))
    counts = np.bincount(groups, minlength=len(prints))
    alone = [
        plan for plan, group in zip(plans, groups[: len(plans)], strict=True) if counts[group] == 1
    ]
    print(f"{len(alone)} of them look like no other")
    return alone[:HOMES]


def useful(source: PlanSource, ids: Sequence[str]) -> Iterator[FloorPlan]:
    """Those of some plans that are worth exploring."""
    for plan_id in ids:
        try:
            plan = source.load(plan_id)
        except PlanError:
            continue
        if passes(plan, "useful"):
            yield plan


def is_as_drawn(plan: FloorPlan) -> bool:
    """True if all corners lie on HouseExpo's grid of 1 cm, as they do in a file that was not repaired."""
    corners = 100.0 * plan.segments()
    return bool(np.abs(corners - np.rint(corners)).max() < 1e-3)


def draw_real(source: PlanSource) -> list[FloorPlan]:
    """Real offices and schools with loops that the robot can explore, the smallest first."""
    found = []
    for plan_id in source.ids:
        try:
            plan = as_shipped(source.load(plan_id))
            check_plan(plan, RobotConfig().radius)
        except PlanError as error:
            print(f"left out: {error.reason}")
            continue
        if plan.free_space.interiors and plan.area <= LARGEST:
            found.append(plan)
    return sorted(found, key=lambda plan: plan.area)


def offices(name: str, count: int, area: tuple[float, float]) -> list[FloorPlan]:
    """Generated offices with a loop; their streams are not those that anything was trained on."""
    config = PlanGeneratorConfig(kind="office", office_area=area, loops=1.0)
    made: list[FloorPlan] = []
    index = 0
    while len(made) < count:
        rng = np.random.default_rng((SEED, round(area[0]), index))
        plan = as_shipped(generate_plan(rng, config, f"{name}_{index:02d}"))
        index += 1
        try:
            check_plan(plan, RobotConfig().radius)
        except PlanError:
            continue
        if plan.free_space.interiors:
            made.append(plan)
    return made


def as_shipped(plan: FloorPlan) -> FloorPlan:
    """The plan as the archive's reader will give it, under a name that is one of a file."""
    name = as_file_name(plan.id)
    return parse_houseexpo(format_houseexpo(dataclasses.replace(plan, id=name)), name, name)


def write_archive(plans: Sequence[FloorPlan]) -> None:
    """One file each; the same plans give the same bytes."""
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w", format=tarfile.USTAR_FORMAT) as archive:
        for plan in plans:
            content = format_houseexpo(plan).encode()
            member = tarfile.TarInfo(f"{plan.id}.json")
            member.size = len(content)
            archive.addfile(member, io.BytesIO(content))
    SHIPPED_PLANS.write_bytes(lzma.compress(buffer.getvalue(), preset=9))


def freeze(track: Track, plans: Sequence[FloorPlan]) -> Track:
    """Draw seeds and starts, in an order that makes the first explorations a sample of all."""
    by_id = {plan.id: plan for plan in plans}
    buildings = []
    for plan_id in shuffled(list(by_id), SEED):
        plan = by_id[plan_id]
        seed = exploration_seed(SEED, f"{track.name}/{plan_id}", 0)
        env = ExploreEnv(plan, fitted_env(plan, track.trial.env, "auto"))
        env.reset(seed=seed, options={"plan": plan})
        x, y, theta = env.start
        building = TrackBuilding(
            plan_id, outline_hash(plan), seed, (round(x, 3), round(y, 3), round(theta, 4))
        )
        env.reset(
            seed=seed, options={"plan": plan, "start": building.start}
        )  # rounding may have moved it into a wall
        faces = furniture_of(plan, seed, track)
        buildings.append(
            building if track.clutter.is_empty else dataclasses.replace(building, furniture=faces)
        )
    areas = sorted(plan.area for plan in plans)
    print(
        f"{track.name}: {len(buildings)}, {areas[0]:.0f} to {areas[-1]:.0f} m2, median {np.median(areas):.0f}"
    )
    return dataclasses.replace(track, buildings=tuple(buildings))


def write_manifest(tracks: Sequence[Track]) -> None:
    """One exploration a line."""
    parts = []
    for track in tracks:
        rows = [
            {key: value for key, value in dataclasses.asdict(building).items() if value != (0, 0.0)}
            for building in track.buildings
        ]
        head = {"about": track.about, "shipped": track.shipped, "clutter": to_dict(track.clutter)}
        lines = ",\n   ".join(json.dumps(row) for row in rows)
        parts.append(
            f'  {json.dumps(track.name)}: {json.dumps(head)[:-1]}, "buildings": [\n   {lines}]}}'
        )
    opening = f' "bench": {json.dumps(BENCH)},\n "version": {BENCH_VERSION},\n "tracks": {{\n'
    MANIFEST.write_text("{\n" + opening + ",\n".join(parts) + "\n }\n}\n", encoding="utf-8")


if __name__ == "__main__":
    main()
