"""How soon is the learned explorer done, beside others, on some buildings of each track of slamgym-bench?

    python benchmarks/exploring/tracks.py json.tar.gz [--count 25] [--tracks homes,loops] [--explorers rl,explore_lite]

Same buildings, starts and noise for all, the promise ``98%:95%`` for those that promise. Ratios are sums of times over
all buildings, kept or not, and where both keep it. What the folder already holds is not explored again. The first five
buildings of a track are left out: on those of two tracks it was tried how many beams meet a person.
"""

import dataclasses
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from slamgym.agents.bench.manifest import bench_tasks, open_bench_plans, read_bench
from slamgym.agents.evaluation.evaluate import EvaluationConfig, run_trials
from slamgym.agents.evaluation.summary import succeeded
from slamgym.agents.evaluation.trial import Trial
from slamgym.core.intervals import Interval, ratio_of_means, wilson_interval

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

FIRST = 5
"""The first building."""


@dataclass(frozen=True)
class Arguments:
    """Explore tracks and compare."""

    plans: tyro.conf.Positional[str]
    """HouseExpo plans."""
    count: int = 25
    """Buildings of each track."""
    tracks: str = "homes,furnished,people"
    """Names, with commas between them."""
    explorers: str = "rl,tour"
    """The same; all are compared with the first."""
    out: Path = Path("out/tracks")
    """Folder of the explorations."""


def main() -> None:
    arguments = tyro.cli(Arguments)
    names = tuple(arguments.explorers.split(","))
    rows: list[dict[str, Any]] = []
    for name in arguments.tracks.split(","):
        track = read_bench().track(name)
        track = dataclasses.replace(track, buildings=track.buildings[FIRST : FIRST + arguments.count])
        source = open_bench_plans(track, arguments.plans)
        found = []
        for explorer in names:
            config = EvaluationConfig(
                explorers=(explorer,), split=None, plans_filter="none", trial=track.trial
            )
            found.append(
                run_trials(bench_tasks(track, source, explorer), config, arguments.out / name).trials
            )
        rows += [{"track": name, **figures(found[0], other)} for other in found]
    print_and_save(f"exploring/tracks_{'_'.join(names)}", f"{names[0]} beside others", rows, list(rows[0]))


def figures(ours: list[Trial], theirs: list[Trial]) -> dict[str, Any]:
    """Figures of an explorer, and those of ours divided by them; trials in the same order."""
    pairs = list(zip(ours, theirs, strict=True))
    both = [pair for pair in pairs if all(map(succeeded, pair))]
    kept = wilson_interval(sum(map(succeeded, theirs)), len(theirs))
    return {
        "explorer": theirs[0].explorer,
        "plans": len(pairs),
        "kept [%]": shown(Interval(*(100.0 * one for one in dataclasses.astuple(kept))), 0),
        "time until done [s]": round(float(np.mean([one.time for one in theirs]))),
        "our time / this": ratio(pairs, "time"),
        "where both keep it": ratio(both, "time"),
        "our map error / this": ratio(pairs, "map_error"),
        "decision [CPU ms]": round(1e3 * float(np.mean([one.decision_cpu for one in theirs])), 1),
    }


def ratio(pairs: list[tuple[Trial, Trial]], figure: str) -> str:
    """Ratio of the sums of a figure, with its interval over plans."""
    values = np.array([[getattr(one, figure) for one in pair] for pair in pairs])
    return shown(ratio_of_means(values[:, 0], values[:, 1]), 2)


def shown(interval: Interval, digits: int) -> str:
    """A figure and its interval."""
    value, low, high = (f"{one:.{digits}f}" for one in dataclasses.astuple(interval))
    return f"{value} [{low}, {high}]"


if __name__ == "__main__":
    main()
