"""``slamgym watch``: see a robot explore, in a window or in a film."""

import dataclasses
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import imageio
import numpy as np
import tyro

from slamgym.cad import FloorPlan, open_plans
from slamgym.core.config import suggest
from slamgym.core.errors import ConfigError
from slamgym.core.progress import say
from slamgym.core.staged import staged
from slamgym.core.types import ByteArray
from slamgym.dataset.schedule import schedule
from slamgym.envs import ExploreConfig, ExploreEnv
from slamgym.envs.episode import MakeExplorer, episode_steps, time_limit
from slamgym.sim import ClutterConfig, LidarConfig, RobotConfig, odometry_level
from slamgym.slam import SlamConfig

FILM_FORMATS = (".mp4", ".gif")


@dataclass(frozen=True)
class WatchArguments:
    """Watch a robot explore a floor plan, in a window or in a film."""

    plans: str = "bundled"
    """Floor plans, as `slamgym generate` takes them."""
    plan: str | None = None
    """Id of the plan; by default one that follows from the seed."""
    explorer: str = "rl"
    """Who drives: ``rl``, ``explore_lite``, ``nearest``, ..."""
    out: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None
    """Film to write, .mp4 or .gif; without it a window opens."""
    minutes: Literal["auto"] | float = "auto"
    """Limit of robot time [min]."""
    speed: float = 16.0
    """Film: how much faster than the robot."""
    fps: float = 20.0
    """Film: frames per second; a .gif can have 50 at most."""
    particles: int = 30
    """Particles of the SLAM filter."""
    odometry: Literal["ideal", "low", "medium", "high"] = "medium"
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


def main(argv: list[str], make_explorer: MakeExplorer) -> int:
    """Run the command; returns the exit code."""
    arguments = tyro.cli(WatchArguments, args=argv, prog="slamgym watch")
    _check(arguments)
    plan = _choose_plan(arguments)
    env = _make_env(arguments, plan)
    try:
        steps = _explore(env, plan, arguments, make_explorer)
        if arguments.out is None:
            for _ in steps:
                pass
        else:
            _write_film(arguments, env, steps)
            sys.stdout.write(f"{arguments.out}\n")
    finally:
        env.close()
    return 0


def _check(arguments: WatchArguments) -> None:
    output = arguments.out
    if output is not None and output.suffix.lower() not in FILM_FORMATS:
        raise ConfigError(f"--out {output}: a film is an .mp4 or a .gif")
    for name in ("speed", "fps"):
        if not 0.0 < getattr(arguments, name) < 1000.0:
            raise ConfigError(f"--{name} must be positive, not {getattr(arguments, name)}")


def _choose_plan(arguments: WatchArguments) -> FloorPlan:
    plans = open_plans(arguments.plans)
    if arguments.plan is None:
        return plans.load(next(schedule(plans.ids, arguments.seed)).plan_id)
    if arguments.plan not in plans.ids:
        raise ConfigError(
            f"{arguments.plans} has no plan {arguments.plan!r}; {suggest(arguments.plan, plans.ids[:1000])}"
        )
    return plans.load(arguments.plan)


def _make_env(arguments: WatchArguments, plan: FloorPlan) -> ExploreEnv:
    config = ExploreConfig(
        robot=arguments.robot,
        lidar=arguments.lidar,
        odometry=odometry_level(arguments.odometry),
        slam=dataclasses.replace(arguments.slam, particles=arguments.particles),
        clutter=arguments.clutter,
        time_limit=time_limit(plan, arguments.minutes),
    )
    return ExploreEnv(
        plan, config.for_explorer(), render_mode="human" if arguments.out is None else "rgb_array"
    )


def _explore(
    env: ExploreEnv, plan: FloorPlan, arguments: WatchArguments, make_explorer: MakeExplorer
) -> Iterator[dict[str, Any]]:
    """Step through the exploration; yields the environment's info after each step."""
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
    assert arguments.out is not None
    stride = max(1, round(arguments.speed / arguments.fps / env.config.control_step))
    with staged(arguments.out) as part, _open_film(part, arguments.fps) as film:
        for number, _ in enumerate(steps):
            if number % stride == 0:
                film.append_data(_even(env.render()))
        film.append_data(_even(env.render()))


def _open_film(path: Path, fps: float) -> Any:
    if path.suffix.lower() == ".gif":
        return imageio.get_writer(path, format="GIF", duration=1000.0 / fps, loop=0)
    # The default block size of 16 would scale the picture.
    return imageio.get_writer(path, format="FFMPEG", fps=fps, macro_block_size=2)


def _even(frame: ByteArray) -> ByteArray:
    """H.264 wants even numbers of rows and columns."""
    rows, cols = frame.shape[:2]
    return np.pad(frame, ((0, rows % 2), (0, cols % 2), (0, 0)), mode="edge")
