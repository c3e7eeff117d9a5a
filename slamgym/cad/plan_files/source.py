"""Drawings as a source of floor plans."""

from collections.abc import Sequence
from pathlib import Path

from slamgym.cad.floorplan import FloorPlan
from slamgym.cad.plan_files.drawn_plan import DrawnPlan
from slamgym.cad.plan_files.dxf import read_dxf
from slamgym.cad.plan_files.geojson import read_geojson
from slamgym.cad.plan_files.ifc import read_ifc, storeys_of
from slamgym.core.errors import InputFileError, PlanError
from slamgym.core.limits import shown

DRAWING_SUFFIXES = (".dxf", ".ifc", ".geojson")


class DrawingSource:
    """The plan of a DXF or GeoJSON drawing, or those of an IFC model's storeys.

    Args:
        path: The file.
        unit: Metres of one unit of a DXF drawing; None takes what it says itself.
        layers: Of a DXF drawing's walls, see :func:`slamgym.cad.plan_files.read_dxf`.
    """

    def __init__(self, path: Path, unit: float | None = None, layers: Sequence[str] = ()) -> None:
        self._path, self._unit, self._layers = path, unit, layers
        self._storeys: dict[str, str] = {}
        if path.suffix.lower() == ".ifc":
            storeys = storeys_of(path)
            for name in storeys:
                plan_id = path.stem if len(storeys) == 1 else f"{path.stem}-{name}"
                if plan_id in self._storeys:
                    raise InputFileError(path, f"has two storeys called {shown(name)}; rename one")
                self._storeys[plan_id] = name
        self.ids: Sequence[str] = list(self._storeys) or [path.stem]

    def __len__(self) -> int:
        return len(self.ids)

    def with_layers(self, layers: Sequence[str]) -> "DrawingSource":
        """The same drawing, with the walls in these layers."""
        return DrawingSource(self._path, self._unit, layers)

    def load(self, plan_id: str) -> FloorPlan:
        """Read one plan.

        Raises:
            PlanError: Also if the drawing doesn't say its unit.
        """
        plan, doubts = self.read(plan_id)
        if doubts:
            raise PlanError(
                self._path, f"{doubts[0]}; give the metres of a unit, as in {self._path.name}@0.001"
            )
        return plan

    def read(self, plan_id: str) -> DrawnPlan:
        """Read one plan, with what is doubtful about it."""
        if plan_id not in self.ids:
            raise KeyError(plan_id)
        if self._storeys:
            return read_ifc(self._path, self._storeys[plan_id])
        if self._path.suffix.lower() == ".geojson":
            return read_geojson(self._path)
        return read_dxf(self._path, self._unit, self._layers)
