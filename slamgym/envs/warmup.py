"""Compiling the numeric kernels once after an installation, rather than in the first exploration."""

import shapely

from slamgym.cad import FloorPlan
from slamgym.core.jit import announce_compilation
from slamgym.core.types import OccupancyGrid, Pose2D
from slamgym.envs.batch.env import BatchExploreEnv
from slamgym.envs.config import ExploreConfig
from slamgym.envs.explore_env import ExploreEnv
from slamgym.envs.explore_frontiers_env import ExploreFrontiersEnv
from slamgym.planning import Goal, Navigator, find_frontiers
from slamgym.sim import cast_rays
from slamgym.slam import SlamConfig


def warm_up() -> None:
    """Compile the kernels of exploration: a moment of driving and mapping, and of navigation."""
    announce_compilation(cast_rays)
    plan = _two_rooms()
    for mode in ("ground_truth", "rbpf", "pose_graph"):
        config = ExploreConfig(slam=SlamConfig(mode=mode, particles=2))
        env = ExploreEnv(plan, config, reward={"map_error": 1.0}, clutter={"furniture": 1.0, "people": 1})
        env.reset(seed=0)
        for _ in range(12):
            env.step((1.0, 0.5))
        # Nose to the wall, for the kernels of contact; furniture may stand there.
        env = ExploreEnv(plan, config)
        env.reset(seed=0, options={"start": (0.24, 1.0, 3.14)})
        env.step((1.0, 0.0))
    for preset in ("compact_far", "map"):
        batch = BatchExploreEnv(1, plan, localization="ground_truth", observation={"preset": preset})
        batch.reset(seed=0)
        batch.step(batch.action_space.sample())
    _navigate(ExploreEnv(plan, config.for_explorer(), observation={"map_size": 8.0}))
    decisions = ExploreFrontiersEnv(plan, localization="ground_truth", observation={"map_size": 10.0})
    decisions.reset(seed=0, options={"start": (0.8, 1.0, 0.0)})
    decisions.step(0)


def _navigate(env: ExploreEnv) -> None:
    """Drive to a goal on the map."""
    context = env.explorer_context()
    navigator = Navigator(context)
    observation, _ = env.reset(seed=0, options={"start": (0.8, 1.0, 0.0)})
    for step in range(12):
        pose, time = Pose2D(*observation["pose"].tolist()), float(observation["time"][0])
        if step % 10 == 0:
            navigator.update_map(OccupancyGrid(observation["map"][0], context.frame), pose, time)
        if step == 0:
            navigator.set_goal(Goal(0.5, 0.0), pose, time)
        command = navigator.step(pose, observation["scan"], time)
        observation, *_ = env.step(context.to_action(command))
    if navigator.costmap is not None:
        find_frontiers(navigator.costmap, pose)


def _two_rooms() -> FloorPlan:
    outline = [(0.0, 0.0), (4.0, 0.0), (4.0, 3.0), (2.2, 3.0), (2.2, 1.5), (1.8, 1.5), (1.8, 3.0), (0.0, 3.0)]
    return FloorPlan("warm-up", shapely.Polygon(outline))
