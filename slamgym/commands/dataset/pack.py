"""``slamgym dataset pack``: rendered images as shards that stream, and their way to the hub."""

from pathlib import Path
from typing import Annotated

import tyro

from slamgym.core.config import Arguments
from slamgym.core.progress import counted, show_progress, tell


class PackArguments(Arguments):
    """Pack rendered images into WebDataset shards (tar) and Parquet files that programs can stream.

    The same command goes on where an interrupted one stopped.
    """

    images: tyro.conf.Positional[Path]
    """A folder that `slamgym dataset render` has written."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Folder of the shards."""
    parquet: bool = True
    """Also write Parquet files (needs pyarrow, extra `hub`)."""
    push_to_hub: str | None = None
    """Also upload them to the Hugging Face hub under this name, USER/NAME (extra `hub`; log in by `hf auth login`)."""
    private: bool = False
    """On the hub: visible to its owner alone."""


def main(argv: list[str]) -> int:
    """Run the command; returns the exit code."""
    arguments = tyro.cli(PackArguments, args=argv, prog="slamgym dataset pack")
    from slamgym.dataset.images.format import iterate_images
    from slamgym.dataset.images.pack import pack_images, push_to_hub

    total = sum(1 for _ in iterate_images(arguments.images))
    with show_progress("pairs packed", 0, total) as advance:
        paths = pack_images(arguments.images, arguments.out, arguments.parquet, advance)
    size = sum(path.stat().st_size for path in paths)
    tell(f"{arguments.out}: {counted(total, 'pair')} in {counted(len(paths), 'file')}, {size / 1e6:.1f} MB")
    if arguments.push_to_hub is not None:
        tell(f"{push_to_hub(arguments.out, arguments.push_to_hub, arguments.private)}")
    return 0
