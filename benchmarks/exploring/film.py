"""A film of explorers side by side: the same building, start and noise, on one clock.

    python benchmarks/exploring/film.py --plans bundled --plan home_000018 office_000003 --out out/film.gif

One building after the other; a robot that is done waits for the others.
"""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np

from slamgym.agents.registry import make_explorer
from slamgym.cad import FloorPlan, open_plans
from slamgym.core.types import ByteArray
from slamgym.envs import ExploreConfig, ExploreEnv
from slamgym.envs.episode import episode_steps, fitted_env
from slamgym.viz.films import open_film

CAPTION = 24
"""Height of the line above a picture [px]."""
AT_THE_END = 1.5
"""Time for which the last picture of a building stays [s]."""


def pictures(
    plan: FloorPlan, explorer: str, seed: int, stride: int, height: int
) -> Iterator[ByteArray]:
    """Every n-th moment of an exploration, with a caption."""
    config = fitted_env(plan, ExploreConfig().for_explorer(), "auto")
    env = ExploreEnv(plan, config, render_mode="rgb_array")
    chosen = make_explorer(explorer, env.explorer_context(), seed)
    info = {"coverage": 0.0}
    steps = episode_steps(env, chosen, env.reset(seed=seed))
    for number, info in enumerate(steps):
        if number % stride == 0:
            yield captioned(env, explorer, info["coverage"], height)
    yield captioned(env, f"{explorer}, done", info["coverage"], height)
    print(f"{plan.id}, {explorer}: {env.simulation.time:.0f} s, {info['coverage']:.1%} seen")


def captioned(env: ExploreEnv, name: str, share: float, height: int) -> ByteArray:
    """The picture of an environment under its explorer's name, the time and what was seen."""
    picture = np.asarray(env.render())
    width = round(picture.shape[1] * height / picture.shape[0])
    picture = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
    line = np.full((CAPTION, width, 3), 255, dtype=np.uint8)
    text = f"{name}   {env.simulation.time:.0f} s   {share:.0%}"
    cv2.putText(
        line, text, (6, CAPTION - 8), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (40, 40, 40), 1, cv2.LINE_AA
    )
    return np.vstack([line, picture])


def beside_each_other(films: Sequence[Iterator[ByteArray]]) -> Iterator[ByteArray]:
    """Several films in one picture; one that has ended stays."""
    latest: list[ByteArray | None] = [None] * len(films)
    while True:
        news = [next(film, None) for film in films]
        if all(picture is None for picture in news):
            return
        latest = [old if new is None else new for old, new in zip(latest, news, strict=True)]
        yield np.hstack([picture for picture in latest if picture is not None])


def on_canvas(picture: ByteArray, height: int, width: int) -> ByteArray:
    """A picture in the upper left of a white one."""
    canvas = np.full((height, width, 3), 255, dtype=np.uint8)
    canvas[: picture.shape[0], : picture.shape[1]] = picture
    return canvas


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plans", default="bundled")
    parser.add_argument("--plan", nargs="+", required=True, help="ids of buildings")
    parser.add_argument("--explorers", nargs="+", default=["tour@98%:95%", "rl@98%:95%"])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--speed", type=float, default=20.0, help="how much faster than the robot")
    parser.add_argument("--fps", type=float, default=10.0)
    parser.add_argument("--height", type=int, default=300, help="of each picture [px]")
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    source = open_plans(arguments.plans)
    stride = max(1, round(arguments.speed / arguments.fps / ExploreConfig().control_step))
    parts: list[list[ByteArray]] = []
    for plan in map(source.load, arguments.plan):
        films = [
            pictures(plan, explorer, arguments.seed, stride, arguments.height)
            for explorer in arguments.explorers
        ]
        parts.append(list(beside_each_other(films)))
    height, width = (max(part[0].shape[axis] for part in parts) for axis in (0, 1))
    with open_film(arguments.out, arguments.fps) as show:
        for part in parts:
            for picture in [*part, *[part[-1]] * round(AT_THE_END * arguments.fps)]:
                show(on_canvas(picture, height, width))
    print(arguments.out)


if __name__ == "__main__":
    main()
