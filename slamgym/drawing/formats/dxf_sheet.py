"""The sheet of a DXF drawing: paper space in millimetres, a viewport to scale in which the plan is upright, a title.

LibreCAD has no paper space; it reads scale and paper from the header instead, and prints the model to that scale.
"""

import datetime as dt
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from slamgym.core.progress import counted
from slamgym.core.types import FloatArray
from slamgym.drawing.drawing import Drawing
from slamgym.drawing.formats.svg import LETTERS
from slamgym.viz.canvas import round_length

BORDER = 10.0
"""Margin of the paper [mm]."""
TITLE = 28.0
"""Height of the strip with the title [mm]."""
MM = 1000.0
"""A metre in millimetres."""
LEAST_ACCURACY = 0.05
"""Lengths are no surer than this, or than a cell of the map where that is more [m]: 81 % of the room widths in homes of
the recipe ``reference`` are within it (``docs/drawing/quality.md``)."""
SHEET_LAYER = "A-ANNO-TTLB"
"""Layer of all that is drawn on the sheet."""


class Paper(NamedTuple):
    """A size of paper, and the scale to which is drawn on it."""

    name: str
    width: float  # [mm]
    height: float  # [mm]
    scale: int  # 1 to this

    @property
    def letters(self) -> float:
        """Height of letters [m of the building]."""
        return 1e-3 * LETTERS * self.scale

    @property
    def view(self) -> tuple[float, float]:
        """Width and height of the building that there is room for [m]."""
        width = self.width - 2.0 * BORDER
        height = self.height - 2.0 * BORDER - TITLE
        return width * self.scale / MM, height * self.scale / MM


def fitting_paper(width: float, height: float) -> Paper:
    """The smallest paper for a drawing so wide and high [m] to 1:50 or 1:100; A0 to a smaller scale if need be."""
    from ezdxf.addons.drawing.layout import PAGE_SIZES

    choices = [(size, scale) for size in ("A4", "A3", "A2", "A1", "A0") for scale in (50, 100)]
    choices += [("A0", scale) for scale in (200, 500, 1000, 2000, 5000, 10_000)]
    for size, scale in choices:
        longer, shorter, _ = PAGE_SIZES[f"ISO {size}"]
        across, up = (longer, shorter) if width > height else (shorter, longer)
        paper = Paper(size, across, up, scale)
        view_width, view_height = paper.view
        if max(width / view_width, height / view_height) < 0.98:
            break
    return paper


def add_sheet(document: Any, drawing: Drawing, paper: Paper, middle: FloatArray) -> None:
    """Draw the sheet as the layout; a middle (2,) [mm of the building] lies in the middle of its viewport."""
    name = f"{paper.name} 1-{paper.scale}"
    document.layouts.rename("Layout1", name)
    sheet = _Sheet(document.layout(name), paper)
    sheet.add_viewport(middle, drawing.angle_deg)
    sheet.add_title(drawing)
    on_paper = np.array([0.5 * paper.width, 0.5 * (paper.height + TITLE)])
    document.header["$PSVPSCALE"] = 1.0 / paper.scale
    document.header["$PINSBASE"] = (*(on_paper - middle / paper.scale), 0.0)


class _Sheet:
    """A layout in millimetres of paper, the origin at its lower left corner."""

    def __init__(self, layout: Any, paper: Paper) -> None:
        self._layout = layout
        self._paper = paper
        self._width = paper.width - 2.0 * BORDER
        """Within the margins [mm]."""
        layout.page_setup((paper.width, paper.height), (BORDER,) * 4, scale=(1, 1))

    def add_viewport(self, middle: FloatArray, angle_deg: float) -> None:
        """Show the building with its main walls along the sheet."""
        paper = self._paper
        size = np.array([self._width, paper.height - 2.0 * BORDER - TITLE])
        centre = np.array([0.0, TITLE]) + 0.5 * size
        view = self._layout.add_viewport(
            centre, size, (0.0, 0.0), size[1] * paper.scale, dxfattribs={"layer": SHEET_LAYER}
        )
        view.dxf.view_target_point = (*middle, 0.0)
        view.dxf.view_twist_angle = -angle_deg

    def add_title(self, drawing: Drawing) -> None:
        """Draw frame and title, a scale bar and the map's y axis."""
        width = self._width
        height = self._paper.height - 2.0 * BORDER
        metre = MM / self._paper.scale
        bar = round_length(0.2 * self._paper.view[0])
        end = width - 26.0
        start = end - bar * metre
        self._add_line([(0, 0), (width, 0), (width, height), (0, height), (0, 0)])
        self._add_line([(0, TITLE), (width, TITLE)])
        self._add_line([(start, 13), (start, 11), (end, 11), (end, 13)])
        turn = math.radians(-drawing.angle_deg)
        along = np.array([-math.sin(turn), math.cos(turn)])
        across = np.array([along[1], -along[0]])
        foot = np.array([width - 12.0, 7.0])
        tip = foot + 12.0 * along
        head = [tip - 4.0 * along + side * across for side in (1.5, -1.5)]
        self._add_line([foot, tip, *head, tip])
        provenance = drawing.provenance
        source = Path(str(provenance.get("source", drawing.name))).name
        cell = drawing.grid.frame.resolution
        accuracy = 100.0 * max(LEAST_ACCURACY, cell)
        made = f"{dt.date.today().isoformat()}, slamgym {provenance.get('slamgym', '')}"
        rooms = counted(len(drawing.rooms), "room")
        scale = f"1:{self._paper.scale} on {self._paper.name}"
        lines = [
            f"{drawing.area:.1f} m² of floor, {rooms}; {scale}; {made}",
            f"Source: {source[:60]}, a robot's map with cells of {100.0 * cell:g} cm",
            f"Lengths in metres, most within {accuracy:.0f} cm; furniture along a wall is drawn as wall",
            "Swings of doors and thicknesses of walls seen from one side are assumed",
        ]
        self._add_text(4.0, 21.5, drawing.name[:40], letters=4.5)
        for number, words in enumerate(lines):
            self._add_text(4.0, 16.0 - 4.2 * number, words, letters=2.2)
        self._add_text(start, 6.5, f"{bar:g} m")
        self._add_text(width - 16.0, 1.5, "y of the map", letters=1.8)

    def _add_line(self, points: Any) -> None:
        """A line through points (N, 2) from the corner within the margins [mm]."""
        self._layout.add_lwpolyline(np.array(points), dxfattribs={"layer": SHEET_LAYER})

    def _add_text(self, x: float, y: float, words: str, letters: float = 2.5) -> None:
        """Words at a place from the corner within the margins, with letters of a height [mm]."""
        add_text(self._layout, words, (x, y), letters, SHEET_LAYER)


def add_text(
    space: Any, words: str, at: Any, height: float, layer: str, align: str = "LEFT"
) -> Any:
    """A line of text at a point; returns the entity."""
    from ezdxf.enums import TextEntityAlignment

    attributes = {"style": "PLAN", "layer": layer}
    text = space.add_text(words, height=height, dxfattribs=attributes)
    return text.set_placement(tuple(at), align=TextEntityAlignment[align])
