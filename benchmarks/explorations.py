"""Whole explorations: CPU seconds of 7 minutes of robot time, and where they go.

    python benchmarks/explorations.py [--explorations 10] [--minutes 7] [--particles 30]

An exploration is what ``slamgym generate`` does for one pair, on one core: the environment with 180 beams,
the explorer, and writing images, maps, trajectories and the log. Explorers that are done early need less than
the full time, so the sums are scaled to the full robot time.
"""

import functools
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import tyro
from report import print_and_save

from slamgym.agents.explorer import BatchedExplorer
from slamgym.agents.registry import make_explorer
from slamgym.cad import FloorPlan, open_plans
from slamgym.dataset import PairConfig, make_pair
from slamgym.dataset.format import write_episode
from slamgym.dataset.generate.schedule import schedule
from slamgym.envs import Episode, EpisodeConfig, ExploreConfig, ExploreEnv, run_episode
from slamgym.envs.warmup import warm_up
from slamgym.sim import Lidar, WheelOdometry, World
from slamgym.slam import SlamConfig
from slamgym.slam.particle_filter import ParticleFilter

GOAL = 4.0
"""CPU seconds of a 7-minute exploration with 30 particles and 180 beams, in total."""

PARTS: dict[str, list[tuple[Any, str]]] = {
    "SLAM": [(ParticleFilter, "update")],
    "explorer (frontiers, navigation)": [(BatchedExplorer, "predict")],
    "world and sensors": [
        (World, "step"),
        (Lidar, "look"),
        (Lidar, "measure"),
        (WheelOdometry, "update"),
    ],
    "observation (map published)": [(ExploreEnv, "_observe")],
    "coverage, errors, log": [(ExploreEnv, "step")],
}
"""What a part's functions do themselves, without what they call of the other parts."""


@dataclass(frozen=True)
class Arguments:
    """CPU time of whole explorations."""

    explorations: int = 10
    """How many, each of another plan."""
    minutes: float = 7.0
    """Limit of robot time; the paper's 7."""
    particles: int = 30
    """Particles of the filter."""
    plans: str = "bundled"
    """Floor plans, as `slamgym generate` takes them."""
    seed: int = 0
    """Seed of the dataset."""


class Profile:
    """CPU seconds by part; nested parts are charged to the inner one alone."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self._inner = [0.0]

    def timed(self, part: str, function: Any) -> Any:
        """A function that charges its time to a part."""

        @functools.wraps(function)
        def run(*args: Any, **kwargs: Any) -> Any:
            self._inner.append(0.0)
            began = time.process_time()
            try:
                return function(*args, **kwargs)
            finally:
                spent = time.process_time() - began
                self.seconds[part] += spent - self._inner.pop()
                self._inner[-1] += spent

        return run

    @contextmanager
    def watching(self) -> Iterator[None]:
        """Time the parts inside the block."""
        kept = [(owner, name, getattr(owner, name)) for places in PARTS.values() for owner, name in places]
        for part, places in PARTS.items():
            for owner, name in places:
                setattr(owner, name, self.timed(part, getattr(owner, name)))
        try:
            yield
        finally:
            for owner, name, function in kept:
                setattr(owner, name, function)


@dataclass(frozen=True)
class Cost:
    """What one exploration took."""

    robot_seconds: float
    cpu_seconds: float


def main() -> None:
    arguments = tyro.cli(Arguments)
    warm_up()
    env = ExploreConfig(slam=replace(SlamConfig(), particles=arguments.particles))
    config = EpisodeConfig(minutes=arguments.minutes, env=env)
    plans = open_plans(arguments.plans)
    slots = list(islice(schedule(plans.ids, arguments.seed), arguments.explorations))
    profile = Profile()
    # The first run loads compiled kernels from disk; it is not counted.
    explore(plans.load(slots[0].plan_id), slots[0].seed, replace(config, minutes=0.5), Profile())
    with profile.watching():
        costs = [explore(plans.load(slot.plan_id), slot.seed, config, profile) for slot in slots]
    report(arguments, profile, costs)


def explore(plan: FloorPlan, seed: int, config: EpisodeConfig, profile: Profile) -> Cost:
    """One exploration, written to disk as ``slamgym generate`` writes it."""
    began = time.process_time()
    episode = run_episode(plan, seed, config, make_explorer)
    with TemporaryDirectory() as folder:
        profile.timed("writing the pair", write_pair)(episode, Path(folder))
    return Cost(episode.robot_seconds, time.process_time() - began)


def write_pair(episode: Episode, folder: Path) -> None:
    pair = make_pair(episode.plan, episode.start, episode.slam_map, PairConfig())
    cv2.imwrite(str(folder / "A.png"), pair.cad)
    cv2.imwrite(str(folder / "B.png"), pair.slam)
    write_episode(folder, episode)


def report(arguments: Arguments, profile: Profile, costs: list[Cost]) -> None:
    total = sum(cost.cpu_seconds for cost in costs)
    scale = 60.0 * arguments.minutes / sum(cost.robot_seconds for cost in costs)
    parts = sorted(profile.seconds.items(), key=lambda item: -item[1])
    parts += [("start, other", total - sum(profile.seconds.values())), ("all", total)]
    rows = [[part, round(seconds * scale, 3), round(100.0 * seconds / total, 1)] for part, seconds in parts]
    title = (
        f"CPU seconds of {arguments.minutes:g} min of robot time, {arguments.particles} particles; "
        f"{len(costs)} explorations of {arguments.plans}, {60.0 / (total * scale):.1f} per CPU minute; "
        f"goal {GOAL:g} s"
    )
    print_and_save("exploring/explorations", title, rows, ["part", "CPU [s]", "share [%]"])


if __name__ == "__main__":
    main()
