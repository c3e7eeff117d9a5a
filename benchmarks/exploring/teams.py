"""Time until a team has seen 98 % of the floor, against one robot, and against simpler ways to share frontiers out.

    python benchmarks/exploring/teams.py [--homes 50] [--offices 12] [--teams rl,rl*2,rl*3,nearest*2] [--seconds 500]

Homes and offices are generated ones that nothing was chosen on. ``rl*2`` are two robots with the explorer ``rl``;
behind a ``?`` the robots don't know each other's starts, as in ``rl*2?``. All robots of a building begin at starts
drawn from its seed, the first one's alike for all teams. Explorations in ``--out`` are not done again; with
``--seconds`` none is begun later, and the same command goes on. ``--only-table`` makes the table of what is there.
"""

import argparse
import dataclasses
import itertools
import json
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from slamgym.agents.evaluation.report import with_bounds
from slamgym.agents.evaluation.team_trial import TeamName
from slamgym.agents.evaluation.trial import TrialConfig
from slamgym.agents.registry import make_explorer
from slamgym.cad import FloorPlan, open_plans
from slamgym.core.intervals import mean_interval, ratio_of_means
from slamgym.core.types import FloatArray
from slamgym.envs.episode import fitted_env
from slamgym.envs.explore_env import explorer_context
from slamgym.envs.plan_cache import ResetOptions
from slamgym.envs.team.episode import team_steps
from slamgym.envs.team.exploration import TeamExploration

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

MODULES = ("agents", "slamgym/envs", "slamgym/planning", "slamgym/slam")
"""What is measured."""
SOURCES = {"homes": "procedural:home:7301", "offices": "procedural:office:7302"}
LARGEST = {"homes": 150.0, "offices": 350.0}
"""Larger plans are left out [m2]."""
FIRST_SEED = 1000
LEVEL = 0.98
Done = dict["Exploration", dict[str, Any]]
"""Outcomes of explorations."""
TEAMS = "rl,rl*2,rl*3,nearest*2,nearest*3,auction*2,auction*3,rl*2?"


@dataclass(frozen=True)
class Exploration:
    """One building by one team."""

    kind: str
    number: int
    team: str

    def run(self) -> dict[str, Any]:
        """Explore until the level is seen, the explorers are done or the time is up."""
        config = TrialConfig()
        name = TeamName.read(self.team.removesuffix("?"))
        plan = self.plan()
        fitted = fitted_env(plan, config.env, config.minutes)
        starts: Any = "unknown" if self.team.endswith("?") else "known"
        settings = dataclasses.replace(fitted.team, robots=name.robots, starts=starts)
        env = dataclasses.replace(fitted, team=settings)
        team = TeamExploration(plan, env)
        seed = FIRST_SEED + self.number
        context = explorer_context(env)
        explorers = [
            make_explorer(name.explorer, context, seed, config.promise) for _ in range(name.robots)
        ]
        began = time.process_time()
        for _ in team_steps(team, explorers, seed, ResetOptions(plan)):
            if team.coverage >= LEVEL:
                break
        return {
            "time": team.time if team.coverage >= LEVEL else None,
            "limit": env.time_limit,
            "area": plan.area,
            "contacts": sum(robot.collisions for robot in team.robots),
            "cpu": time.process_time() - began,
        }

    def plan(self) -> FloorPlan:
        """The building."""
        source = open_plans(SOURCES[self.kind])
        plans = (source.load(plan_id) for plan_id in source.ids)
        small = (plan for plan in plans if plan.area <= LARGEST[self.kind])
        return next(itertools.islice(small, self.number, None))


def wanted(arguments: argparse.Namespace) -> Iterator[Exploration]:
    """All explorations, building by building, so that what is there at any time is balanced."""
    counts = {"homes": arguments.homes, "offices": arguments.offices}
    for number in range(max(counts.values())):
        for kind, count in counts.items():
            if number < count:
                for team in arguments.teams.split(","):
                    yield Exploration(kind, number, team)


def read(out: Path) -> Done:
    """What is done."""
    lines = out.read_text().splitlines() if out.exists() else []
    found = [json.loads(line) for line in lines]
    return {Exploration(**one["exploration"]): one["outcome"] for one in found}


def run_all(arguments: argparse.Namespace) -> bool:
    """Explore what is left; False if time is up before."""
    done = read(arguments.out)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    begun = time.monotonic()
    for one in wanted(arguments):
        if one in done:
            continue
        if time.monotonic() - begun > arguments.seconds:
            return False
        outcome = one.run()
        record = {"exploration": dataclasses.asdict(one), "outcome": outcome}
        with arguments.out.open("a") as file:
            file.write(json.dumps(record) + "\n")
        print(one, outcome, flush=True)
    return True


def times_of(done: Done, kind: str, team: str) -> dict[int, float]:
    """Time to the level by building [s]; the time limit where it wasn't reached."""
    return {
        one.number: outcome["time"] or outcome["limit"]
        for one, outcome in done.items()
        if (one.kind, one.team) == (kind, team)
    }


def ratio(ours: dict[int, float], theirs: dict[int, float]) -> str | None:
    """Of the means on the buildings of both."""
    both = sorted(ours.keys() & theirs.keys())
    if not both or ours is theirs:
        return None
    return with_bounds(ratio_of_means(_array(ours, both), _array(theirs, both)))


def _array(values: dict[int, float], numbers: list[int]) -> FloatArray:
    return np.array([values[number] for number in numbers])


def rows(done: Done) -> Iterator[list[Any]]:
    """A row for each kind of building and team."""
    for kind in SOURCES:
        teams = dict.fromkeys(one.team for one in done if one.kind == kind)
        for team in teams:
            own = times_of(done, kind, team)
            name = TeamName.read(team.removesuffix("?"))
            outcomes = [o for one, o in done.items() if (one.kind, one.team) == (kind, team)]
            alone = times_of(done, kind, name.explorer)
            if not alone:
                alone = times_of(done, kind, "rl")
            rival = times_of(done, kind, f"nearest*{name.robots}") if name.robots > 1 else {}
            missed = sum(one["time"] is None for one in outcomes)
            yield [
                kind,
                name.explorer,
                name.robots,
                "unknown" if team.endswith("?") else "known",
                len(own),
                missed,
                with_bounds(mean_interval(np.array(list(own.values()))), 0),
                ratio(own, alone) if name.robots > 1 else None,
                ratio(own, rival) if name.explorer != "nearest" else None,
                float(np.mean([one["contacts"] for one in outcomes])),
                float(np.mean([one["cpu"] for one in outcomes])),
            ]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--homes", type=int, default=50)
    parser.add_argument("--offices", type=int, default=12)
    parser.add_argument("--teams", default=TEAMS)
    parser.add_argument("--seconds", type=float, default=float("inf"))
    parser.add_argument("--out", type=Path, default=Path("out/teams.jsonl"))
    parser.add_argument("--only-table", action="store_true")
    arguments = parser.parse_args()
    if not arguments.only_table and not run_all(arguments):
        raise SystemExit(3)
    print_and_save(
        "exploring/teams",
        "Time until a team has seen 98 % of the floor; a miss counts as the time limit",
        list(rows(read(arguments.out))),
        [
            "buildings",
            "explorer",
            "robots",
            "starts",
            "count",
            "missed",
            "98% [s]",
            "/ one",
            "/ nearest",
            "contacts",
            "CPU [s]",
        ],
        MODULES,
        times=("CPU [s]",),
    )


if __name__ == "__main__":
    main()
