"""Maps that were made before, as parts of a merge: folders with a graph, and bare maps of anybody."""

from pathlib import Path

from slamgym.core.errors import InputFileError
from slamgym.interop.map_files import read_map
from slamgym.slam.graph.graph_files import GRAPH, read_graph
from slamgym.slam.merge.merging import Part


def stored_part(path: Path) -> Part:
    """Read a map that was made before, with its graph if it has one.

    Raises:
        InputFileError: If it can't be read, or is turned in its frame.
    """
    if (path / GRAPH).exists():
        return Part.of_graph(str(path), read_graph(path))
    known = read_map(path)
    if known.placement.theta != 0.0:
        raise InputFileError(
            path,
            f"is turned by {known.placement.theta:g} rad, and maps are drawn upright; turn its image and set the yaw "
            "to 0",
        )
    return Part.of_picture(str(path), known.grid)
