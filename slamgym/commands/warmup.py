"""``slamgym warmup``: compile the numeric kernels, once after an installation."""

from dataclasses import dataclass

import tyro

from slamgym.core.progress import tell


@dataclass(frozen=True)
class WarmupArguments:
    """Compile the numeric kernels of exploration, which the first exploration would wait for otherwise."""


def main(argv: list[str]) -> int:
    """Run the command; returns the exit code."""
    tyro.cli(WarmupArguments, args=argv, prog="slamgym warmup")
    from slamgym.core.jit import kernel_cache
    from slamgym.envs.warmup import warm_up
    from slamgym.sim.raycast import cast_rays

    warm_up()
    tell(f"the kernels are compiled: {kernel_cache(cast_rays)} and the folders beside it")
    return 0
