"""Compiling the numeric kernels once after an installation, rather than in the first exploration.

The kernels come in parts, each compiled by a moment of what needs it, in parallel processes. The first three
have hardly a kernel in common; the others come after them, because they call the same ones.
"""

import contextlib
import functools
import gc
import io
import math
from collections.abc import Callable, Collection
from typing import Any

import numpy as np
import shapely

from slamgym.cad import FloorPlan
from slamgym.core.jit import count_compiled, is_compiled
from slamgym.core.parallel.backlog import available_cores
from slamgym.core.parallel.engine import Execution
from slamgym.core.portable import product
from slamgym.core.progress import say, show_count
from slamgym.core.types import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    Float32Array,
    GridFrame,
    LaserGeometry,
    LaserScan,
    OccupancyGrid,
    Pose2D,
)
from slamgym.envs.batch.env import BatchExploreEnv
from slamgym.envs.config import ExploreConfig
from slamgym.envs.explore_env import ExploreEnv
from slamgym.envs.explore_frontiers_env import ExploreFrontiersEnv
from slamgym.envs.far_look import write_far
from slamgym.planning import ExplorerContext, Goal, Navigator, find_frontiers
from slamgym.planning.frontier_feature_kernels import explore_unknown_regions
from slamgym.planning.open_tour import lengths_by_first, open_tour, short_paths
from slamgym.planning.unmapped import unmapped_points
from slamgym.sim import ClutterConfig
from slamgym.sim.motion import settle
from slamgym.sim.passages import next_clear
from slamgym.slam import SlamConfig, make_mapper
from slamgym.slam.branch_and_bound import search_blocks
from slamgym.slam.config import PoseGraphConfig
from slamgym.slam.laser_changes import seen_after
from slamgym.slam.tiles import copy_maps

BATCHED = "batch"
"""The part that only many environments at once call."""
_MOST_WORKERS = 3
"""More processes would compile what they have in common at the same time."""
_LASER = LaserGeometry(180, 0.01 - math.pi, math.radians(2.0), 0.1, 8.0)
"""A scanner that sees all round."""


def warm_up() -> None:
    """Compile all kernels in this process, or bring them into it."""
    for part, _ in KERNEL_PARTS.values():
        part()


def compile_for(env: ExploreConfig, execution: Execution, is_varied: bool = False) -> None:
    """Compile what explorations in such an environment call: once, rather than in each of their processes.

    Args:
        env: The environment.
        execution: Where they run.
        is_varied: Whether other settings may be drawn.
    """
    if execution.engine == "in_process":
        return
    names = {"drive", "navigate", "decide", env.slam.mode}
    if env.clutter != ClutterConfig():
        names.add("furnish")
    if is_varied:
        names = KERNEL_PARTS.keys() - {BATCHED}
    workers = execution.workers if execution.engine == "local" else available_cores()
    compile_kernels(names, workers)


def compile_kernels(names: Collection[str], workers: int) -> None:
    """Compile the parts of these names that aren't yet, in separate processes, and show the progress.

    Args:
        names: Of :data:`KERNEL_PARTS`.
        workers: Most processes.
    """
    fresh = []
    for name, (_, last_kernel) in KERNEL_PARTS.items():
        if name in names and not is_compiled(last_kernel):
            fresh.append(name)
    if not fresh:
        return
    say("slamgym: compiling the numeric kernels, once after installation")
    execution = Execution(min(workers, _MOST_WORKERS, len(fresh)), task_timeout=None)
    with show_count("kernels compiled", count_compiled), execution.open() as engine:
        for _ in engine.run(_compile, fresh):
            pass


def _compile(name: str) -> str:
    """Compile a part in a process that does nothing else; returns its name."""
    gc.disable()  # most of what a compiler makes it keeps: to look for what it doesn't takes a tenth of its time
    with contextlib.redirect_stderr(io.StringIO()):  # the parent has said that it takes a while
        KERNEL_PARTS[name][0]()
    return name


def _drive() -> None:
    """Drive and scan with a known pose, and then with the nose to the wall, for the kernels of contact."""
    env = ExploreEnv(
        _two_rooms(),
        ExploreConfig().for_explorer(),
        localization="ground_truth",
        reward={"map_error": 1.0},
    )
    env.reset(seed=0)
    for _ in range(12):
        env.step((1.0, 0.5))
    env.reset(seed=0, options={"start": (0.24, 1.0, 3.14)})
    for _ in range(12):
        env.step((1.0, 0.0))


def _match(mode: Any) -> None:
    """Map a room in two rounds, and search for the last scan, which fits nowhere."""
    graph = PoseGraphConfig(loop_length=1.0)
    config = SlamConfig(mode=mode, particles=2, resample_threshold=1.0, pose_graph=graph)
    mapper = make_mapper(config, _LASER, Pose2D(0.0, 0.0, 0.0), np.random.default_rng(0))
    for step in range(24):
        turn = 0.6 * step
        pose = Pose2D(0.8 * math.sin(turn), 0.8 - 0.8 * math.cos(turn), turn)
        ranges = _seen_from(pose, 1.5 if step < 23 else 1.1)
        scan = LaserScan(2.0 * step, ranges, _LASER)
        mapper.update(pose, scan)
    mapper.finish()
    seen_after(scan, Pose2D(0.1, 0.0, 0.0))
    mapper.render(GridFrame(0.1, -4.0, -4.0, 80, 80))


def _navigate() -> None:
    """Drive to a goal on a map of a room."""
    frame = GridFrame(0.05, -4.0, -4.0, 160, 160)
    cells = np.full(frame.shape, UNKNOWN, np.uint8)
    cells[50:111, 50:111] = OCCUPIED
    cells[50:110, 51:110] = FREE
    navigator = Navigator(ExplorerContext(frame=frame, geometry=_LASER))
    pose = Pose2D(0.0, 0.0, 0.0)
    navigator.update_map(OccupancyGrid(cells, frame), pose, 0.0)
    if navigator.costmap is not None:
        find_frontiers(navigator.costmap, pose)
    navigator.set_goal(Goal(0.8, 0.0), pose, 0.0)
    for step in range(12):
        # Something stands in the way that the map doesn't hold.
        ranges = _seen_from(pose, 1.5 if step == 0 else 0.23)
        command = navigator.step(pose, ranges, 0.2 * step)
        pose = Pose2D(pose.x, pose.y, pose.theta + 0.2 * command.angular)
    for count in (4, 14):
        lengths = np.ones((count, count))
        open_tour(lengths)
        lengths_by_first(lengths)


def _decide() -> None:
    """Choose among frontiers."""
    env = ExploreFrontiersEnv(
        _two_rooms(), localization="ground_truth", observation={"map_size": 10.0}
    )
    env.reset(seed=0, options={"start": (0.8, 1.0, 0.0)})
    # As the networks of explorers do.
    product(np.ones((1, 1), np.float32), np.ones((1, 1)))
    unmapped_points(env.loop.known_map(), np.zeros((1, 2)), 0.1)
    env.step(0)


def _furnish() -> None:
    """Drive among furniture and people."""
    env = ExploreEnv(
        _two_rooms(), localization="ground_truth", clutter={"furniture": 1.0, "people": 1}
    )
    env.reset(seed=0)


def _step_many() -> None:
    """Step many robots at once."""
    for preset in ("map", "compact_far"):
        batch = BatchExploreEnv(
            1, _two_rooms(), localization="ground_truth", observation={"preset": preset}
        )
        batch.reset(seed=0)
        batch.step(batch.action_space.sample())


KERNEL_PARTS: dict[str, tuple[Callable[[], None], Callable[..., Any]]] = {
    "rbpf": (functools.partial(_match, "rbpf"), copy_maps),
    "drive": (_drive, settle),
    "navigate": (_navigate, short_paths),
    BATCHED: (_step_many, write_far),
    "pose_graph": (functools.partial(_match, "pose_graph"), search_blocks),
    "furnish": (_furnish, next_clear),
    "decide": (_decide, explore_unknown_regions),
}
"""Function that compiles each part, and a kernel that it compiles at its end."""


def _seen_from(pose: Pose2D, half: float) -> Float32Array:
    """Ranges of a scan in a square room about the origin, whose side is twice ``half`` [m]."""
    angles = pose.theta + _LASER.angles
    x = np.cos(angles)
    y = np.sin(angles)
    to_side = (half * np.sign(x) - pose.x) / x
    to_front = (half * np.sign(y) - pose.y) / y
    return np.minimum(to_side, to_front).astype(np.float32)


def _two_rooms() -> FloorPlan:
    outline = [
        (0.0, 0.0),
        (4.0, 0.0),
        (4.0, 3.0),
        (2.2, 3.0),
        (2.2, 1.5),
        (1.8, 1.5),
        (1.8, 3.0),
        (0.0, 3.0),
    ]
    return FloorPlan("warm-up", shapely.Polygon(outline))
