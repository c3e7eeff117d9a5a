"""Map and path that each SLAM mode makes of one recorded log."""

import numpy as np
import pytest

from slamgym.agents.registry import make_explorer
from slamgym.cad import open_plans
from slamgym.envs import EpisodeConfig, ExploreConfig
from slamgym.envs.episode import run_episode
from slamgym.interop.records import Log
from slamgym.slam import SlamConfig
from slamgym.slam.replay import replay

PLAN = "home_loops_4_00001"
WAYS = {
    "rbpf": SlamConfig(mode="rbpf", particles=8),
    "scan_matching": SlamConfig(mode="rbpf", particles=1),
    "pose_graph": SlamConfig(mode="pose_graph"),
    "dead_reckoning": SlamConfig(mode="dead_reckoning"),
    "ground_truth": SlamConfig(mode="ground_truth"),
    "gmapping": SlamConfig.gmapping(particles=3),
    "ros_defaults": SlamConfig(
        mode="rbpf", max_usable_range=80.0, angular_update=0.5, temporal_update=None, particles=4
    ),
    "log": SlamConfig.for_log(3.5, 180),
}


@pytest.fixture(scope="module")
def episode():
    plan = open_plans("procedural:home:loops:4").load(PLAN)
    config = EpisodeConfig(
        explorer="nearest", minutes=4.0, env=ExploreConfig(slam=SlamConfig(mode="ground_truth"))
    )
    return run_episode(plan, 3, config, make_explorer)


def test_the_log_itself(episode, golden):
    ranges = np.stack([record.scan.ranges for record in episode.records])
    measured = {
        "truth": golden.of_path(episode.truth.poses),
        "odometry": golden.of_path(episode.odometry.poses),
        "ranges": golden.rounded_digest(ranges),
        "coverage": round(episode.coverage, 6),
        "collisions": episode.collisions,
        "finished": episode.finished,
    }
    golden.check("slam/the log", measured)


@pytest.mark.parametrize("way", WAYS)
def test_replay(episode, golden, way):
    log = Log("an episode", list(episode.records), episode.geometry)
    result = replay(log, WAYS[way], np.random.default_rng(7))
    frame = result.grid.frame
    measured = {
        "map": golden.of_cells(result.grid.cells),
        "origin": [round(frame.origin_x, 6), round(frame.origin_y, 6)],
        "processed": golden.of_path(result.processed.poses),
        "path": golden.of_path(result.trajectory.poses),
        "resamplings": result.stats.resamplings,
        "refused matches": result.stats.refused_matches,
        "n_eff": golden.rounded_digest(result.stats.n_eff),
        "report": dict(result.extra),
    }
    golden.check(f"slam/{way}", measured)
