"""Compiling the numeric kernels: once after an installation, and not without a word.

``python -m slamgym.warmup`` compiles them all.
"""

import functools
import sys
from pathlib import Path

EXPECTED_SECONDS = 45
"""About what the kernels take to compile on one core of a 2020s server."""


def kernel_cache() -> Path:
    """The folder of compiled kernels: beside the sources, or wherever numba keeps it."""
    from slamgym.sensors.raycast import cast_rays

    return Path(cast_rays.stats.cache_path)  # type: ignore[attr-defined]


def kernels_are_compiled() -> bool:
    """Whether there are compiled kernels."""
    return any(kernel_cache().glob("*.nbi"))


@functools.cache
def announce_compilation() -> None:
    """Say on stderr that the first steps will take a while, if they will; at most once in a process."""
    if not kernels_are_compiled():
        sys.stderr.write(
            f"slamgym: compiling the numeric kernels, once after installation: about {EXPECTED_SECONDS} s\n"
        )
        sys.stderr.flush()


def warm_up() -> None:
    """Compile all kernels by running a moment of an episode in a room, in every localisation mode."""
    import shapely

    from slamgym.cad import FloorPlan
    from slamgym.envs import ExploreConfig, ExploreEnv
    from slamgym.slam import SlamConfig

    announce_compilation()
    outline = [(0.0, 0.0), (4.0, 0.0), (4.0, 3.0), (2.2, 3.0), (2.2, 1.5), (1.8, 1.5), (1.8, 3.0), (0.0, 3.0)]
    plan = FloorPlan("warm-up", shapely.Polygon(outline))
    for mode in ("ground_truth", "rbpf"):
        for view in ("egocentric", "global"):
            env = ExploreEnv(
                plan,
                ExploreConfig(slam=SlamConfig(mode=mode, particles=2)),
                observation={"map": view, "map_size": 8.0},
                clutter={"people": 1},
                reward={"map_error": 1.0},
            )
            env.reset(seed=0)
            for _ in range(12):
                env.step((1.0, 0.5))
            # Into the wall, for the kernels of contact.
            env.reset(seed=0, options={"start": (0.24, 1.0, 3.14)})
            env.step((1.0, 0.0))


if __name__ == "__main__":
    warm_up()
