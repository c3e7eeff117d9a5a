"""The second edition of the reference dataset: explorations, cleaning, splits and images, by one command.

    python benchmarks/dataset/edition.py --houseexpo json.tar.gz --schools polimi.jsonl.xz --out edition2

Before anything is explored, every plan of HouseExpo and every school goes to one side: plans that look alike share a
group, and a tenth of the groups, by the hash of their first id, are the test side, which nobody trains or tunes on.
Generated plans of the test side come from another seed. Three datasets are made:

* ``train``: training plans by the recipe ``edition2``;
* ``test``: test plans by the same recipe;
* ``test_paper``: test plans by the recipe ``paper`` alone, as many as leave 300 maps after cleaning.

All steps can be interrupted; the same command goes on. ``--report`` writes the tables for what is there.
"""

import json
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

from slamgym.agents.registry import make_explorer
from slamgym.cad import PlanSource, open_plans
from slamgym.cad.plan_filter import passes
from slamgym.cad.plan_index import mixed_plans, some_plans
from slamgym.core.errors import PlanError
from slamgym.core.files import replace_file, sha256_of
from slamgym.core.intervals import wilson_interval
from slamgym.core.names import uniform_share
from slamgym.dataset import DatasetConfig, build_dataset, read_manifest
from slamgym.dataset.curate.near_duplicates import near_duplicates, plan_print
from slamgym.dataset.curate.verdicts import read_verdicts
from slamgym.dataset.format import Layout
from slamgym.dataset.generate.recipe import MIXTURE, open_recipe
from slamgym.dataset.record import GOOD_COVERAGE, PairRecord

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

MODULES = ("slamgym/dataset", "slamgym/envs", "slamgym/planning", "slamgym/sim", "slamgym/slam")
"""What is measured."""

SEED = 2026
TEST_SHARE = 0.1
WEIGHTS = (9.0, 0.05, 0.7, 0.25)
"""HouseExpo, schools, generated homes and offices with loops."""
GENERATED_TEST_SEED = 1000
LARGEST = 1000.0
"""Larger schools are left out [m2]: they would take most of the time."""


@dataclass(frozen=True)
class Part:
    """One of the datasets."""

    side: str
    recipe: str
    pairs: int


PARTS = {
    "train": Part("train", "edition2", 3300),
    "test": Part("test", "edition2", 400),
    "test_paper": Part("test", "paper", 1300),
}


@dataclass(frozen=True)
class Arguments:
    """Make the dataset, or describe what is there."""

    houseexpo: str
    """HouseExpo's plans: a folder or a .tar.gz."""
    schools: str
    """Annotated schools and offices (.jsonl.xz)."""
    out: Path = Path("out/edition2")
    """Folder of the datasets."""
    only: tuple[str, ...] = tuple(PARTS)
    """Datasets to make."""
    share: float = 1.0
    """Make only this share of the explorations."""
    workers: int = 2
    """Processes."""
    report: bool = False
    """Write the tables instead."""


def main() -> None:
    arguments = tyro.cli(Arguments)
    if arguments.report:
        report(arguments.out)
        return
    sources = [open_plans(arguments.houseexpo), open_plans(arguments.schools)]
    sides = plan_sides(sources, arguments.out / "sides.json")
    for name in arguments.only:
        part = PARTS[name]
        config = DatasetConfig(SEED, "useful", trajectories=2, recipe=open_recipe(part.recipe))
        build_dataset(
            arguments.out / name,
            side_plans(sources, sides, part.side),
            config,
            make_explorer,
            pairs=round(arguments.share * part.pairs),
            workers=arguments.workers,
        )


def plan_sides(sources: list[PlanSource], path: Path) -> dict[str, list[str]]:
    """The ids of each side; computed once and kept in a file.

    Args:
        sources: HouseExpo and schools.
        path: The file.
    """
    if path.is_file():
        stored: dict[str, list[str]] = json.loads(path.read_text())
        return stored
    ids, prints = [], []
    for source in sources:
        for plan_id in source.ids:
            try:
                plan = source.load(plan_id)
            except PlanError:
                continue
            if passes(plan, "useful") and plan.area <= LARGEST:
                ids.append(plan_id)
                prints.append(plan_print(plan))
    groups = near_duplicates(np.stack(prints))
    sides: dict[str, list[str]] = {"train": [], "test": []}
    for plan_id, group in zip(ids, groups, strict=True):
        is_test = uniform_share(f"edition/{ids[group]}") < TEST_SHARE
        sides["test" if is_test else "train"].append(plan_id)
    path.parent.mkdir(parents=True, exist_ok=True)
    replace_file(path, json.dumps(sides).encode())
    return sides


def side_plans(sources: list[PlanSource], sides: dict[str, list[str]], side: str) -> PlanSource:
    """The plans of a side, as often as the weights say."""
    chosen = set(sides[side])
    drawn = [some_plans(source, [i for i in source.ids if i in chosen]) for source in sources]
    seed = f":{GENERATED_TEST_SEED}" if side == "test" else ""
    generated = [open_plans(f"procedural:{kind}:loops{seed}") for kind in ("home", "office")]
    # A side may have no school.
    there = [
        (plans, weight)
        for plans, weight in zip([*drawn, *generated], WEIGHTS, strict=True)
        if len(plans)
    ]
    return mixed_plans(*zip(*there, strict=True))


def report(out: Path) -> None:
    """Yield by recipe and reason, and the digests that name the edition."""
    rows, digests = [], [["sides.json", sha256_of(out / "sides.json")]]
    faults = Counter[tuple[str, str]]()
    for name, part in PARTS.items():
        root = out / name
        if not Layout(root).manifest.is_file():
            continue
        digests.append([f"{name}/manifest.jsonl", sha256_of(Layout(root).manifest)])
        verdicts, groups = read_verdicts(root), dict[str, list[PairRecord]]()
        for record in read_manifest(root):
            groups.setdefault(str(record.conditions.get(MIXTURE, part.recipe)), []).append(record)
        for recipe, records in sorted(groups.items()):
            rows.append(
                [
                    name,
                    recipe,
                    *figures(records, [verdicts[record.name].keep for record in records]),
                ]
            )
            dropped = (
                verdicts[record.name] for record in records if not verdicts[record.name].keep
            )
            faults.update((recipe, verdict.faults[0].reason) for verdict in dropped)
    columns = ["part", "recipe", "pairs", "seen [%]", "kept", "kept [%]", "ATE median, 95 % [m]"]
    print_and_save(
        "dataset/edition", "Explorations", rows, [*columns, "walls median, 95 % [m]"], MODULES
    )
    reasons = [[*key, count] for key, count in faults.most_common()]
    print_and_save(
        "dataset/edition_faults",
        "Why the others were left out",
        reasons,
        ["recipe", "fault", "pairs"],
        MODULES,
    )
    print_and_save(
        "dataset/edition_digests", "What names the edition", digests, ["file", "SHA-256"], MODULES
    )


def figures(records: Sequence[PairRecord], kept: Sequence[bool]) -> list[object]:
    """Share seen and kept, with its interval, position and wall errors."""
    count, interval = len(records), wilson_interval(sum(kept), len(records))
    seen = sum(record.coverage >= GOOD_COVERAGE for record in records)
    ate, walls = (
        ", ".join(f"{value:.2f}" for value in np.percentile(errors, [50.0, 95.0]))
        for errors in ([r.ate for r in records], [r.map_error for r in records])
    )
    share = f"{100 * sum(kept) / count:.1f} [{100 * interval.low:.1f}, {100 * interval.high:.1f}]"
    return [count, round(100 * seen / count, 1), sum(kept), share, ate, walls]


if __name__ == "__main__":
    main()
