"""``slamgym deform``: from a floor plan to the maps that SLAM would have drawn of it."""

import time

from slamgym.commands.deforming.arguments import DeformArguments
from slamgym.core.progress import tell


def main(arguments: DeformArguments) -> None:
    """Run the command.

    Raises:
        SlamgymError: If something is wrong that the user can fix; nothing is left half written.
    """
    from slamgym.commands.deforming.dataset import write_dataset
    from slamgym.commands.deforming.hypotheses import hypotheses, subjects

    begun = time.perf_counter()
    made = write_dataset(hypotheses(subjects(arguments), arguments), arguments)
    tell(f"{made} in {time.perf_counter() - begun:.1f} s: {arguments.out}")
