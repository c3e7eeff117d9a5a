"""Two robots explore an office together, through PettingZoo's interface, and their maps become one.

Needs the extra `teams`. Run: ``python examples/two_robots.py [PLAN] [MINUTES] [FILM.gif]``
"""

import contextlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np

from slamgym import ExploreConfig, make_explorer, write_ros_map
from slamgym.core.types import ByteArray
from slamgym.envs import team
from slamgym.envs.explore_env import explorer_context
from slamgym.envs.team.env import ExploreTeamEnv
from slamgym.envs.team.episode import merged_map
from slamgym.viz.films import open_film

FILM_EVERY, FRAMES, WIDTH = 30, 10.0, 800
"""A picture of the film shows each so many-th step, at so many a second, so wide [px]."""


@contextlib.contextmanager
def filming(env: ExploreTeamEnv, path: str) -> Iterator[Callable[[int], None]]:
    """Film some steps; without a path nothing."""
    if not path:
        yield lambda _: None
        return
    with open_film(Path(path), FRAMES) as show:

        def film(step: int) -> None:
            if step % FILM_EVERY == 0:
                picture = np.asarray(env.render())
                height = round(WIDTH * picture.shape[0] / picture.shape[1])
                small: ByteArray = np.asarray(
                    cv2.resize(picture, (WIDTH, height), None, 0, 0, cv2.INTER_AREA)
                )
                show(small)

        yield film


def explore(plan: str, minutes: float, path: str) -> None:
    """Let one explorer drive each robot until all are done or the time is up."""
    config = ExploreConfig(time_limit=60.0 * minutes).for_explorer()
    mode = "rgb_array" if path else None
    env = team.parallel_env("bundled", config=config, robots=2, render_mode=mode)
    observations, infos = env.reset(seed=1, options={"plan": plan})
    context = explorer_context(env.config)
    explorers = {name: make_explorer("rl", context) for name in env.agents}
    step = 0
    with filming(env, path) as film:
        while env.agents and not all(one.finished for one in explorers.values()):
            # A robot that hears others finds them in its observation, under "mates".
            actions = {name: explorers[name].predict(observations[name])[0] for name in env.agents}
            observations, _, _, _, infos = env.step(actions)
            film(step)
            step += 1
    seen = infos["robot1"]["coverage"]
    driven = " and ".join(f"{info['path_length']:.0f} m" for info in infos.values())
    print(f"{plan}: {seen:.1%} seen after {env.team.time:.0f} s; the robots drove {driven}")
    folder = Path("two_robots")
    folder.mkdir(exist_ok=True)
    write_ros_map(folder, merged_map(env.team))
    print("the merged map is in two_robots")


if __name__ == "__main__":
    given = sys.argv[1:] + ["office_000000", "20", ""][len(sys.argv) - 1 :]
    explore(given[0], float(given[1]), given[2])
