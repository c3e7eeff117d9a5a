"""``slamgym deform``: from a floor plan to the maps that SLAM would have drawn of it."""

import time

from slamgym.commands.deforming.arguments import DeformArguments
from slamgym.core.progress import tell


def main(arguments: DeformArguments) -> None:
    """Run the command.

    Raises:
        SlamgymError: If something is wrong that the user can fix; nothing is left half written.
    """
    from slamgym.commands.deforming.dataset import open_new_dataset
    from slamgym.commands.deforming.hypotheses import hypotheses, subjects

    begun = time.perf_counter()
    with open_new_dataset(arguments.out, arguments) as dataset:
        for subject, drawn in hypotheses(subjects(arguments), arguments):
            tell(dataset.add(subject, drawn))
    seconds = time.perf_counter() - begun
    tell(f"{dataset.count} map(s) of {dataset.of_what} in {seconds:.1f} s: {arguments.out}")
