"""``slamgym deform``: from a floor plan to the maps that SLAM would have drawn of it."""

import sys
import time

import tyro

from slamgym.commands.deforming.arguments import DeformArguments


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
    from slamgym.commands.deforming.hypotheses import hypotheses, load_plan

    begun = time.perf_counter()
    if arguments.figures:
        from slamgym.commands.deforming.figures import draw_figures

        draw_figures(arguments)
        return 0
    plan = load_plan(arguments)
    with open_new_dataset(arguments.out, plan, arguments) as dataset:
        for hypothesis in hypotheses(plan, arguments):
            sys.stdout.write(dataset.add(hypothesis) + "\n")
    sys.stdout.write(
        f"{arguments.count} map(s) of {plan.id} in {time.perf_counter() - begun:.1f} s: {arguments.out}\n"
    )
    return 0
