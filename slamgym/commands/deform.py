"""``slamgym deform``: from a floor plan to the maps that SLAM would have drawn of it."""

import time

import tyro

from slamgym.commands.deforming.arguments import DeformArguments
from slamgym.core.progress import tell


def main(argv: list[str]) -> int:
    """Run the command.

    Args:
        argv: Arguments after the command's name.

    Returns:
        The exit code.

    Raises:
        SlamgymError: If something is wrong that the user can fix; nothing is left half written.
    """
    arguments = tyro.cli(DeformArguments, args=argv, prog="slamgym deform")
    from slamgym.commands.deforming.dataset import open_new_dataset
    from slamgym.commands.deforming.hypotheses import hypotheses
    from slamgym.commands.deforming.subjects import subjects

    begun = time.perf_counter()
    if arguments.figures:
        from slamgym.commands.deforming.figures import draw_figures

        draw_figures(arguments)
        return 0
    with open_new_dataset(arguments.out, arguments) as dataset:
        for subject, drawn in hypotheses(subjects(arguments), arguments):
            tell(dataset.add(subject, drawn))
    seconds = time.perf_counter() - begun
    tell(f"{dataset.count} map(s) of {dataset.of_what} in {seconds:.1f} s: {arguments.out}")
    return 0
