"""``slamgym drive``: a person drives the robot by keys, in a window, and sees the map grow."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Collection
from typing import Annotated

from slamgym.commands.frame import MaybeOut, open_window
from slamgym.commands.settings import AllSettings, SettingsOptions
from slamgym.core.config import Arguments, Seed, Within
from slamgym.core.progress import say, tell

KEYS = {
    "up": (1.0, 0.0),
    "w": (1.0, 0.0),
    "down": (-1.0, 0.0),
    "s": (-1.0, 0.0),
    "left": (0.0, 0.4),
    "a": (0.0, 0.4),
    "right": (0.0, -0.4),
    "d": (0.0, -0.4),
}
"""Shares of full speed ahead and of full turning rate; at the whole of it (1.82 rad/s) a step of 0.2 s turns by 21
degrees, too much to aim."""
QUIT = ("q", "escape")
_WITHOUT_SCREEN = "drive where there is one, or let slamgym watch --out FILE.mp4 film an explorer"


class DriveArguments(Arguments):
    """Drive the robot by keys: arrows or W A S D; Q ends the drive."""

    plans: str = "bundled"
    """Floor plans, as `slamgym generate` takes them."""
    plan: str | None = None
    """Id of the plan; by default one that follows from the seed."""
    out: MaybeOut = None
    """ROS map to write at the end, without suffix: ``house`` for house.yaml."""
    speed: Annotated[float, Within(gt=0.0, le=100.0)] = 2.0
    """How much faster than the robot the window goes."""
    seed: Seed = 0
    """Seed of everything random."""
    settings: AllSettings = SettingsOptions()
    """Robot, sensors, SLAM, furniture and people."""


def command_of(held: Collection[str]) -> list[float]:
    """The normalised action, speed and turning rate in [-1, 1], for the keys that are held down."""
    moves = [KEYS[key] for key in held if key in KEYS]
    sums = [sum(parts) for parts in zip((0.0, 0.0), *moves, strict=True)]
    return [max(-1.0, min(1.0, value)) for value in sums]


def main(arguments: DriveArguments) -> None:
    """Run the command."""
    from slamgym.commands.watch import choose_plan
    from slamgym.envs import ExploreConfig, ExploreEnv
    from slamgym.envs.episode import fitted_env
    from slamgym.interop import write_ros_map
    from slamgym.viz.window import WindowClosedError

    plan = choose_plan(arguments.plans, arguments.plan, arguments.seed)
    config = arguments.settings.configured(ExploreConfig(), {}).for_explorer()
    config = fitted_env(plan, dataclasses.replace(config, actions="normalized"), "auto")
    frames_per_second = arguments.speed / config.control_step
    with contextlib.ExitStack() as stack:
        window = open_window("slamgym drive", frames_per_second, _WITHOUT_SCREEN)
        stack.callback(window.close)
        env = ExploreEnv(plan, config, render_mode="rgb_array")
        stack.enter_context(contextlib.closing(env))
        _, info = env.reset(seed=arguments.seed)
        truncated = False
        with contextlib.suppress(WindowClosedError):
            while not truncated and window.held.isdisjoint(QUIT):
                *_, truncated, info = env.step(command_of(window.held))
                window.show(env.render())
        say(
            f"{plan.id}: {env.simulation.time / 60.0:.1f} min, {info['path_length']:.0f} m, "
            f"{100.0 * info['coverage']:.1f} % covered, {info['collisions']} contacts, "
            f"position error {info['pose_error']:.2f} m"
        )
        if arguments.out is not None:
            tell(f"{write_ros_map(arguments.out, env.mapper.occupancy_grid())}")
