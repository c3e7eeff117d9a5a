"""The true path of an explorer, for what needs a believable trajectory and no map."""

from slamgym.cad import FloorPlan
from slamgym.core.geometry import transform_poses
from slamgym.core.types import Pose2D, Trajectory
from slamgym.envs.episode import EpisodeConfig, MakeExplorer, run_episode


def record_path(plan: FloorPlan, explorer: str, seed: int, make_explorer: MakeExplorer) -> Trajectory:
    """Let an explorer map a building with the simulated robot and take the path that it truly drove.

    Convention: the result is in the world frame of the plan.

    Args:
        plan: The building.
        explorer: The explorer's name.
        seed: Of the start, the noise and the explorer.
        make_explorer: Makes explorers by name.

    Raises:
        PlanError: If the robot fits nowhere in the plan.
        ConfigError: If there is no explorer of that name.
    """
    episode = run_episode(plan, seed, EpisodeConfig(explorer=explorer), make_explorer)
    world_from_map = Pose2D(episode.start.x, episode.start.y, 0.0)
    return Trajectory(episode.truth.stamps, transform_poses(world_from_map, episode.truth.poses))
