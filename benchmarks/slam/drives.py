"""Simulated drives for judging mappers: scans, wheel readings and truth, kept on disk.

The robot explores with a known pose, so the drive doesn't depend on a mapper, and every mapper is
fed the same one.
"""

import dataclasses
import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from slamgym.agents.registry import make_explorer
from slamgym.cad import FloorPlan, PlanGeneratorConfig, PlanGroup, generate_plan, open_plans
from slamgym.core.config import config_hash
from slamgym.core.types import FloatArray, LaserGeometry, LaserScan, Pose2D, Trajectory
from slamgym.dataset.generate.build import schedule_groups
from slamgym.dataset.record import Slot
from slamgym.envs import EpisodeConfig, ExploreConfig, run_episode
from slamgym.interop import Log, LogRecord
from slamgym.sim import lidar_level, odometry_level
from slamgym.slam import SlamConfig
from slamgym.slam.config import RANGE_MARGIN

DEMO_SEED, DEMO_PLANS = 1, 8
"""Those of ``make demo``."""
FIRST_HOME = 1_000
"""Seed of the first generated home."""


class Conditions(NamedTuple):
    """Errors of wheels and laser by their names, and what else the drives have in common."""

    odometry: str = "medium"
    laser: str = "default"
    range_max: float = 3.5  # [m]
    minutes: float = 7.0  # the longest drive
    view_deg: int = 180  # a beam a degree
    sweep: float = 0.0  # [s]

    def mapper(self, mode: str) -> SlamConfig:
        """Settings of an environment's mapper."""
        usable = self.range_max - RANGE_MARGIN
        return SlamConfig(mode=mode, max_usable_range=usable)  # type: ignore[arg-type]

    def episode(self) -> EpisodeConfig:
        """Settings of an exploration with a known pose."""
        env = ExploreConfig()
        level = env.lidar if self.laser == "default" else lidar_level(self.laser)
        lidar = dataclasses.replace(
            level,
            range_max=self.range_max,
            num_beams=self.view_deg,
            field_of_view_deg=float(self.view_deg),
            sweep=self.sweep,
        )
        return EpisodeConfig(
            "nearest",
            self.minutes,
            env=dataclasses.replace(
                env,
                odometry=odometry_level(self.odometry),
                lidar=lidar,
                slam=self.mapper("ground_truth"),
            ),
        )


@dataclass(frozen=True)
class Drive:
    """A log with its truth, in the map frame."""

    log: Log
    truth: Trajectory  # one pose a scan
    walls: FloatArray  # (S, 4) [m]


def generated_homes(count: int) -> Iterator[tuple[FloorPlan, int]]:
    """Generated homes, each with the seed of its drive."""
    return (
        (generate_plan(FIRST_HOME + k, PlanGeneratorConfig(kind="home")), k) for k in range(count)
    )


def demo_slots(seed: int) -> Iterator[tuple[FloorPlan, Slot]]:
    """The bundled plans that ``make demo`` explores with a seed, each with its place in that dataset."""
    plans = open_plans("bundled")
    slots = schedule_groups([PlanGroup(plans.ids, 1.0)], seed)
    return ((plans.load(slot.plan_id), slot) for slot in itertools.islice(slots, DEMO_PLANS))


def demo_plans() -> Iterator[tuple[FloorPlan, int]]:
    """The bundled plans that ``make demo`` explores, each with the seed of its drive."""
    return ((plan, slot.seed) for plan, slot in demo_slots(DEMO_SEED))


def drive(plan: FloorPlan, seed: int, conditions: Conditions, cache: Path) -> Drive:
    """A drive from the cache, or simulated and put there.

    Args:
        plan: The building.
        seed: Of the start, the noise and the explorer.
        conditions: Errors of the robot.
        cache: Folder of the drives that were simulated before; delete it once the simulator has changed.
    """
    config = conditions.episode()
    errors = f"{config_hash(config.env.odometry)[:6]}{config_hash(config.env.lidar)[:6]}"
    path = cache / f"{plan.id}-{seed}-{conditions.odometry}-{conditions.laser}-{errors}.npz"
    return kept_drive(path, plan, seed, config)


def kept_drive(path: Path, plan: FloorPlan, seed: int, config: EpisodeConfig) -> Drive:
    """A drive from its file, or simulated and written there."""
    if not path.exists():
        _simulate(path, plan, seed, config)
    with np.load(path) as held:
        beams, first, step, nearest, farthest, *mount, each = held["geometry"].tolist()
        geometry = LaserGeometry(
            int(beams), first, step, nearest, farthest, Pose2D(*mount), time_increment=each
        )
        stamps, odometry, motions = held["stamps"], held["odometry"], held["motions"]
        columns = (stamps.tolist(), odometry.tolist(), held["ranges"], motions.tolist())
        records = [
            LogRecord(stamp, Pose2D(*pose), LaserScan(stamp, scan, geometry, Pose2D(*motion)))
            for stamp, pose, scan, motion in zip(*columns, strict=True)
        ]
        truth = Trajectory(stamps, held["truth"])
        return Drive(Log(plan.id, records, geometry), truth, held["walls"])


def _simulate(path: Path, plan: FloorPlan, seed: int, config: EpisodeConfig) -> None:
    episode = run_episode(plan, seed, config, make_explorer)
    records = list(episode.records)
    *beams, mount, each = episode.geometry
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_suffix(".part.npz")
    np.savez_compressed(
        unfinished,
        stamps=np.array([record.stamp for record in records]),
        ranges=np.array([record.scan.ranges for record in records]),
        odometry=np.array([record.odometry for record in records]),
        motions=np.array([record.scan.motion for record in records]),
        truth=episode.truth.poses,
        walls=episode.plan.segments() - np.tile(episode.start[:2], 2),
        geometry=np.array([*beams, *mount, each]),
    )
    unfinished.replace(path)
