"""``slamgym dataset check``: verify every file and name every fault."""

from pathlib import Path

import tyro

from slamgym.core.config import Arguments
from slamgym.core.files import open_regular
from slamgym.core.progress import counted, show_progress, tell

EXIT_FAULTS = 1


class CheckArguments(Arguments):
    """Verify a dataset, or a folder of rendered images: files, digests, shapes, pixel values, lists.

    Every fault is one line. The exit code is 0 if there is none, else 1.
    """

    folder: tyro.conf.Positional[Path]
    """A folder that `slamgym generate` or `slamgym dataset render` has written."""


def main(argv: list[str]) -> int:
    """Run the command; returns the exit code."""
    arguments = tyro.cli(CheckArguments, args=argv, prog="slamgym dataset check")
    from slamgym.dataset.check import check_dataset, check_image_folder, is_image_folder
    from slamgym.dataset.format import require_manifest

    manifest = arguments.folder / "manifest.jsonl"
    require_manifest(manifest, "slamgym generate` or `slamgym dataset render")
    with open_regular(manifest) as file:
        total = sum(chunk.count(b"\n") for chunk in iter(lambda: file.read(1 << 20), b""))
    check = check_image_folder if is_image_folder(arguments.folder) else check_dataset
    with show_progress("pairs checked", 0, total) as advance:
        faults = check(arguments.folder, advance)
    for fault in faults:
        tell(f"{fault}")
    verdict = f"{counted(len(faults), 'fault')}" if faults else "no fault"
    tell(f"{arguments.folder}: {counted(total, 'pair')}, {verdict}")
    return EXIT_FAULTS if faults else 0
