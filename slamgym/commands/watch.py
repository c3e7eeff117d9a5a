"""``slamgym watch``: see a robot explore, in a window or in a film."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Iterator
from dataclasses import field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from slamgym.core.config import Arguments, Count, Positive, Within, suggest
from slamgym.core.errors import ConfigError
from slamgym.core.progress import say
from slamgym.sim import ClutterConfig, LidarConfig, OdometryLevel, RobotConfig
from slamgym.slam import SlamConfig

if TYPE_CHECKING:
    from slamgym.envs import ExploreEnv

if TYPE_CHECKING:
    from slamgym.cad import FloorPlan
    from slamgym.envs import ExploreEnv

_Rate = Annotated[float, Within(gt=0.0, lt=1000.0)]


class WatchArguments(Arguments):
    """Watch a robot explore a floor plan, in a window or in a film."""

    plans: str = "bundled"
    """Floor plans, as `slamgym generate` takes them."""
    plan: str | None = None
    """Id of the plan; by default one that follows from the seed."""
    explorer: str = "rl"
    """Who drives: ``rl``, ``explore_lite``, ``nearest``, ..."""
    out: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None
    """Film to write, .mp4 or .gif; without it a window opens."""
    minutes: Literal["auto"] | Positive = "auto"
    """Limit of robot time [min]."""
    speed: _Rate = 16.0
    """Film: how much faster than the robot."""
    fps: _Rate = 20.0
    """Film: frames per second; a .gif can have 50 at most."""
    particles: Count = 30
    """Particles of the SLAM filter."""
    odometry: OdometryLevel = "medium"
    """Errors of the wheel odometry."""
    seed: int = 0
    """Seed of everything random."""
    robot: RobotConfig = field(default_factory=RobotConfig)
    """Measures and limits of the robot."""
    lidar: LidarConfig = field(default_factory=LidarConfig)
    """The scanner and its errors."""
    slam: SlamConfig = field(default_factory=SlamConfig)
    """Localisation and mapping."""
    clutter: ClutterConfig = field(default_factory=ClutterConfig)
    """Furniture and people, which no CAD map shows."""

    def _check(self) -> None:
        from slamgym.viz.films import check_film_name

        if self.out is not None:
            check_film_name(self.out)


def main(argv: list[str]) -> int:
    """Run the command; returns the exit code."""
    arguments = tyro.cli(WatchArguments, args=argv, prog="slamgym watch")
    plan = _choose_plan(arguments)
    env = _make_env(arguments, plan)
    try:
        steps = _explore(env, plan, arguments)
        if arguments.out is None:
            for _ in steps:
                pass
        else:
            _write_film(arguments, env, steps)
            sys.stdout.write(f"{arguments.out}\n")
    finally:
        env.close()
    return 0


def _choose_plan(arguments: WatchArguments) -> FloorPlan:
    from slamgym.cad import open_plans
    from slamgym.core.seeding import shuffled

    plans = open_plans(arguments.plans)
    if arguments.plan is None:
        return plans.load(shuffled(plans.ids, arguments.seed)[0])
    if arguments.plan not in plans.ids:
        raise ConfigError(
            f"{arguments.plans} has no plan {arguments.plan!r}; {suggest(arguments.plan, plans.ids[:1000])}"
        )
    return plans.load(arguments.plan)


def _make_env(arguments: WatchArguments, plan: FloorPlan) -> ExploreEnv:
    from slamgym.envs import ExploreConfig, ExploreEnv
    from slamgym.envs.episode import fitted_env
    from slamgym.sim import odometry_level

    config = ExploreConfig(
        robot=arguments.robot,
        lidar=arguments.lidar,
        odometry=odometry_level(arguments.odometry),
        slam=dataclasses.replace(arguments.slam, particles=arguments.particles),
        clutter=arguments.clutter,
    )
    config = fitted_env(plan, config.for_explorer(), arguments.minutes)
    return ExploreEnv(plan, config, render_mode="human" if arguments.out is None else "rgb_array")


def _explore(env: ExploreEnv, plan: FloorPlan, arguments: WatchArguments) -> Iterator[dict[str, Any]]:
    """Step through the exploration; yields the environment's info after each step."""
    from slamgym.agents.registry import make_explorer
    from slamgym.envs.episode import episode_steps

    explorer = make_explorer(arguments.explorer, env.explorer_context(), arguments.seed)
    for info in episode_steps(env, explorer, env.reset(seed=arguments.seed)):
        yield info
    ending = "explored" if explorer.finished else "time is up"
    say(
        f"{plan.id}: {ending} after {env.simulation.time / 60.0:.1f} min and {info['path_length']:.0f} m, "
        f"{100.0 * info['coverage']:.1f} % covered, position error {info['pose_error']:.2f} m"
    )


def _write_film(arguments: WatchArguments, env: ExploreEnv, steps: Iterator[dict[str, Any]]) -> None:
    """Write every n-th step as a frame; the file appears when it is complete."""
    from slamgym.viz.films import open_film

    assert arguments.out is not None
    stride = max(1, round(arguments.speed / arguments.fps / env.config.control_step))
    with open_film(arguments.out, arguments.fps) as show:
        for number, _ in enumerate(steps):
            if number % stride == 0:
                show(env.render())
        show(env.render())
