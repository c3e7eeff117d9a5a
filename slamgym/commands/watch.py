"""``slamgym watch``: see robots explore, in a window or in a film."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np

from slamgym.commands.frame import MaybeOut, open_window, require_plan
from slamgym.commands.settings import AllSettings, SettingsOptions
from slamgym.core.config import Arguments, Positive, Seed, Within
from slamgym.core.errors import ConfigError
from slamgym.core.geometry import transform_points, transform_poses
from slamgym.core.progress import say, tell

if TYPE_CHECKING:
    from slamgym.agents.explorer import BatchedExplorer
    from slamgym.cad import FloorPlan
    from slamgym.core.types import ByteArray
    from slamgym.envs import ExploreConfig, ExploreEnv
    from slamgym.planning.exploration_loop import ExplorationLoop
    from slamgym.viz.recording import Deliberation

_Rate = Annotated[float, Within(gt=0.0, lt=1000.0)]
_LAST = 0
"""The last picture is shown whatever its number, as the first one is."""


class WatchArguments(Arguments):
    """Watch a robot explore a floor plan, in a window or in a film."""

    plans: str = "bundled"
    """Floor plans, as `slamgym generate` takes them."""
    plan: str | None = None
    """Id of the plan; by default one that follows from the seed."""
    explorer: str = "rl"
    """Who drives: ``rl``, ``explore_lite``, ``nearest``, ..."""
    robots: Annotated[int, Within(ge=1, le=4)] = 1
    """So many explore the building together."""
    out: MaybeOut = None
    """Film to write, .mp4 or .gif; without film and recording a window opens."""
    rerun: Path | None = None
    """Recording to write, .rrd, which the rerun viewer shows on a timeline: plan, scans, particles, map and
    frontiers (`pip install 'slamgym[viz]'`)."""
    minutes: Literal["auto"] | Positive = "auto"
    """Limit of robot time [min]."""
    speed: _Rate = 16.0
    """Film: how much faster than the robot."""
    fps: _Rate = 20.0
    """Film: frames per second; a .gif can have 50 at most."""
    seed: Seed = 0
    """Seed of everything random."""
    settings: AllSettings = SettingsOptions()
    """Robot, sensors, SLAM, furniture and people."""

    def _check(self) -> None:
        from slamgym.viz.films import check_film_name
        from slamgym.viz.recording import check_recording_name

        if self.out is not None:
            check_film_name(self.out)
        if self.rerun is not None:
            check_recording_name(self.rerun)
            if self.robots > 1:
                raise ConfigError("--rerun records one robot; leave it or --robots out")


def main(arguments: WatchArguments) -> None:
    """Run the command."""
    plan = choose_plan(arguments.plans, arguments.plan, arguments.seed)
    if arguments.robots > 1:
        _explore_together(plan, arguments)
    else:
        from slamgym.envs import ExploreEnv

        env = ExploreEnv(plan, _configure(arguments, plan), render_mode="rgb_array")
        _explore(env, plan, arguments)
    for path in filter(None, (arguments.out, arguments.rerun)):
        tell(f"{path}")


def choose_plan(source: str, plan_id: str | None, seed: int) -> FloorPlan:
    """A plan of a source by its id, or one that follows from the seed."""
    from slamgym.cad import open_plans, plan_groups
    from slamgym.dataset.generate.build import schedule_groups

    plans = open_plans(source)
    if plan_id is None:
        return plans.load(next(schedule_groups(plan_groups(plans), seed)).plan_id)
    return plans.load(require_plan(source, plan_id, plans.ids))


def _configure(arguments: WatchArguments, plan: FloorPlan) -> ExploreConfig:
    from slamgym.envs import ExploreConfig
    from slamgym.envs.episode import fitted_env

    options = {"team.robots": arguments.robots}
    config = arguments.settings.configured(ExploreConfig(), options)
    return fitted_env(plan, config.for_explorer(), arguments.minutes)


def _explore_together(plan: FloorPlan, arguments: WatchArguments) -> None:
    """Run the exploration of a team, in a window or in a film."""
    from slamgym.agents.registry import make_explorer
    from slamgym.envs.explore_env import explorer_context
    from slamgym.envs.plan_cache import ResetOptions
    from slamgym.envs.team.episode import team_steps
    from slamgym.envs.team.exploration import TeamExploration
    from slamgym.viz.exploration import Renderer

    config = _configure(arguments, plan)
    team = TeamExploration(plan, config)
    context = explorer_context(config)
    explorers = [
        make_explorer(arguments.explorer, context, arguments.seed) for _ in range(arguments.robots)
    ]
    renderer = Renderer()
    with contextlib.ExitStack() as files:
        show = _open_screen(files, arguments, config, lambda: renderer.draw(team.scene()))
        for number in team_steps(team, explorers, arguments.seed, ResetOptions(plan)):
            show(number)
        show(_LAST)
    is_explored = all(explorer.finished for explorer in explorers)
    say(
        f"{plan.id}: {'explored' if is_explored else 'time is up'} after {team.time / 60.0:.1f} min by "
        f"{arguments.robots} robots, {100.0 * team.coverage:.1f} % covered"
    )


def _open_screen(
    files: contextlib.ExitStack,
    arguments: WatchArguments,
    config: ExploreConfig,
    draw: Callable[[], ByteArray],
) -> Callable[[int], None]:
    """What shows the picture after a step, in a film each n-th one, or in a window; nothing beside a recording."""
    from slamgym.viz.films import open_film

    if arguments.out is not None:
        stride = max(1, round(arguments.speed / arguments.fps / config.control_step))
        film = files.enter_context(open_film(arguments.out, arguments.fps))

        def show(number: int) -> None:
            if number % stride == 0:
                film(draw())

        return show
    if arguments.rerun is not None:
        return lambda _: None
    window = open_window("slamgym", round(config.lidar.rate), "write a film: --out FILE.mp4")
    files.callback(window.close)
    return lambda _: window.show(draw())


def _explore(env: ExploreEnv, plan: FloorPlan, arguments: WatchArguments) -> None:
    """Run the exploration; every n-th step is a frame of the film, and each a moment of the recording."""
    from slamgym.agents.registry import make_explorer
    from slamgym.envs.episode import episode_steps
    from slamgym.viz.recording import open_recording

    with contextlib.ExitStack() as files:
        show = _open_screen(files, arguments, env.config, env.render)
        recording = (
            files.enter_context(open_recording(arguments.rerun)) if arguments.rerun else None
        )
        watcher = _Watcher(env)
        explorer = make_explorer(arguments.explorer, env.explorer_context(), arguments.seed)
        for number, info in enumerate(episode_steps(env, explorer, env.reset(seed=arguments.seed))):  # noqa: B007 - the last info is shown
            show(number)
            if recording is not None:
                recording.add(env.scene(), watcher.look(explorer))
        show(_LAST)
    ending = "explored" if explorer.finished else "time is up"
    say(
        f"{plan.id}: {ending} after {env.simulation.time / 60.0:.1f} min and {info['path_length']:.0f} m, "
        f"{100.0 * info['coverage']:.1f} % covered, position error {info['pose_error']:.2f} m"
    )


class _Watcher:
    """Looks into a robot's head, in the world frame; what hasn't changed since the last look is the same object."""

    def __init__(self, env: ExploreEnv) -> None:
        self._env = env
        self._latest: tuple[Any, ...] = ()
        self._deliberation: Deliberation

    def look(self, explorer: BatchedExplorer) -> Deliberation:
        """The candidates that the explorer of the environment weighs now."""
        env = self._env
        loop = explorer.loops[0] if explorer.loops else None
        seen = env.mapper.occupancy_grid(), *((loop.candidates, loop.target) if loop else ())
        if len(seen) != len(self._latest) or any(
            a is not b for a, b in zip(seen, self._latest, strict=True)
        ):
            self._deliberation = self._deliberate(loop)
            self._latest = seen
        return self._deliberation

    def _deliberate(self, loop: ExplorationLoop | None) -> Deliberation:
        from slamgym.viz.recording import Deliberation

        env = self._env
        placed = env.simulation.world_from_map
        paths = env.mapper.particle_paths(env.config.slam.particles)
        poses = np.array([path[-1] for path in paths if len(path)] or [env.mapper.pose])
        particles = transform_poses(placed, poses)
        if loop is None:
            return Deliberation(particles)
        offered = [one for one in loop.candidates if one is not loop.target]
        shown = offered if loop.target is None else [*offered, loop.target]
        return Deliberation(
            particles,
            frontiers=[transform_points(placed, one.points) for one in shown],
            chosen=None if loop.target is None else len(offered),
            path=None if loop.target is None else transform_points(placed, loop.target.path),
        )
