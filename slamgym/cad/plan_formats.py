"""The table of all formats of floor plans: files are opened by it, and help, errors and docs list its rows.

A new format is a module with a function that opens a file, and a row here.
"""

import pkgutil
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from slamgym.core.documents import YAML_SUFFIXES
from slamgym.core.pictures import PICTURE_SUFFIXES

if TYPE_CHECKING:
    from slamgym.cad.plan_index import PlanIndex


class PlanOptions(NamedTuple):
    """How a file of floor plans is to be read."""

    scale: float | None = None
    """Metres of a pixel or of a drawing's unit, if they stand behind the file's name."""
    layers: tuple[str, ...] = ()
    """Names or patterns of the layers of a drawing's walls; without any, layers that are called like walls."""
    wanted: frozenset[str] | None = None
    """Ids of the plans that are needed; None for all."""
    may_doubt: bool = False
    """True if a plan may be read whose unit is only guessed."""


class PlanFormat(NamedTuple):
    """A kind of file that holds floor plans."""

    suffixes: tuple[str, ...]
    """Ends of the files' names, in small letters."""
    opener: str
    """``module:function`` that makes a :class:`~slamgym.cad.PlanIndex` of a path and :class:`PlanOptions`."""
    name: str
    """What such a file is called in help pages and errors."""
    content: str
    """What is read of it, as the docs say it."""
    has_scale: bool = False
    """True if ``@`` and the metres of a pixel or unit may stand behind the file's name."""
    has_layers: bool = False
    """True if its walls may be named by their layers."""

    def open(self, path: Path, options: PlanOptions) -> "PlanIndex":
        """The plans of a file; what the format needs is imported now.

        Raises:
            InputFileError: If the file can't be read.
        """
        index: PlanIndex = pkgutil.resolve_name(self.opener)(path, options)
        return index


PLAN_FORMATS = (
    PlanFormat(
        suffixes=(".json",),
        opener="slamgym.cad.houseexpo:open_houseexpo",
        name="HouseExpo's .json",
        content="HouseExpo's format: outline, rooms, and where present doors and holes; also a folder of them",
    ),
    PlanFormat(
        suffixes=(".tar.gz", ".tgz", ".tar"),
        opener="slamgym.cad.archives:open_archive",
        name="a .tar.gz of them",
        content="an archive of these",
    ),
    PlanFormat(
        suffixes=(".dxf",),
        opener="slamgym.cad.dxf:open_dxf",
        name="a .dxf drawing (plan.dxf@0.001 where it doesn't say its unit)",
        content="layers that are called like walls, doors, windows, rooms",
        has_scale=True,
        has_layers=True,
    ),
    PlanFormat(
        suffixes=(".ifc",),
        opener="slamgym.cad.ifc:open_ifc",
        name="an .ifc model",
        content="each storey is a plan: walls, columns, openings, spaces (`pip install '.[ifc]'`)",
    ),
    PlanFormat(
        suffixes=(".geojson",),
        opener="slamgym.cad.geojson:open_geojson",
        name="a .geojson of walls",
        content="features with `properties.kind` wall, door, window or room; or walls alone",
    ),
    PlanFormat(
        suffixes=(".jsonl", ".jsonl.xz"),
        opener="slamgym.cad.room_lines:open_room_lines",
        name="a .jsonl of rooms with portals",
        content="annotated floors, one a line: rooms, and portals between them",
    ),
    PlanFormat(
        suffixes=YAML_SUFFIXES,
        opener="slamgym.cad.image_plan:open_ros_plan",
        name="a ROS map's .yaml",
        content="a ROS map: free cells are floor; the yaw of `origin` turns the plan; also a folder of them",
    ),
    PlanFormat(
        suffixes=PICTURE_SUFFIXES,
        opener="slamgym.cad.image_plan:open_picture",
        name="a picture with its metres per pixel (plan.png@0.05)",
        content="a picture: white is floor; `@` gives the metres of a pixel, as in `plan.png@0.05`",
        has_scale=True,
    ),
)
"""All formats."""

PLAN_FILES = ", ".join(
    [*(row.name for row in PLAN_FORMATS), "or a folder of HouseExpo files or ROS maps"]
)
"""The files that can be read, for help pages and errors."""
PLANS_HELP = (
    f"Floor plans: {PLAN_FILES}; ``bundled``, those of the package; ``procedural``, generated ones, also "
    "``procedural:SEED``, ``procedural:home`` or ``procedural:office:loops``."
)
"""Everything that names floor plans, for help pages."""


def plan_format(name: str) -> PlanFormat | None:
    """The format of a file by the end of its name."""
    for row in PLAN_FORMATS:
        if name.lower().endswith(row.suffixes):
            return row
    return None
