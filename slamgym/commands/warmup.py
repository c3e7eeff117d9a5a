"""``slamgym warmup``: compile the numeric kernels, once after an installation."""

from dataclasses import dataclass

import tyro

from slamgym.core.progress import tell


@dataclass(frozen=True)
class WarmupArguments:
    """Compile the numeric kernels of exploration, which the first exploration would wait for otherwise."""

    batched: bool = False
    """Also those of many environments at once (``slamgym.envs.BatchExploreEnv``, the explorer ``wheels``)."""


def main(argv: list[str]) -> int:
    """Run the command; returns the exit code."""
    arguments = tyro.cli(WarmupArguments, args=argv, prog="slamgym warmup")
    from slamgym.core.jit import kernel_cache
    from slamgym.core.parallel.backlog import available_cores
    from slamgym.envs.warmup import BATCHED, KERNEL_PARTS, compile_kernels
    from slamgym.sim.raycast import cast_sweep

    compile_kernels(KERNEL_PARTS.keys() - (set() if arguments.batched else {BATCHED}), available_cores())
    tell(f"the kernels are compiled: {kernel_cache(cast_sweep)} and the folders beside it")
    return 0
