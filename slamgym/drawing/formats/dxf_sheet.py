"""The sheet of a DXF drawing: paper space with a viewport to scale, a title, a scale bar and the map's y axis."""

from typing import Any, NamedTuple

import numpy as np

from slamgym.core.progress import counted
from slamgym.core.types import FloatArray
from slamgym.drawing.drawing import Drawing
from slamgym.drawing.formats.svg import LETTERS
from slamgym.viz.canvas import round_length

BORDER = 10.0
"""Margin of the paper [mm]."""
TITLE = 22.0
"""Height of the strip with the title [mm]."""
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
        return 1e-3 * width * self.scale, 1e-3 * height * self.scale


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
    """Draw the sheet round a middle (2,) [m] as the layout, in the building's coordinates, plotted to scale.

    Programs that don't know paper space show it round the building, where it belongs.
    """
    name = f"{paper.name} 1-{paper.scale}"
    document.layouts.rename("Layout1", name)
    sheet = _Sheet(document.layout(name), paper, middle)
    sheet.set_up()
    sheet.add_viewport()
    sheet.add_title(drawing)


class _Sheet:
    """A layout whose paper lies round a middle (2,) of the building [m]."""

    def __init__(self, layout: Any, paper: Paper, middle: FloatArray) -> None:
        self._layout = layout
        self._paper = paper
        self._middle = middle
        self._metre = 1000.0 / paper.scale
        """Length of a metre of the building on paper [mm]."""
        self._frame = np.array([paper.width, paper.height]) - 2.0 * BORDER
        """Width and height within the margins [mm]."""
        with_title = self._frame + np.array([0.0, TITLE])
        self._corner = middle - 0.5 * with_title / self._metre
        """The lower left corner within the margins, in the building's coordinates [m]."""

    def set_up(self) -> None:
        """Set size and scale of the paper, and what is shown of it."""
        paper = self._paper
        metre = self._metre
        corner = self._corner
        margins = (BORDER, BORDER, BORDER, BORDER)
        self._layout.page_setup(
            (paper.width, paper.height), margins, offset=tuple(-metre * corner), scale=(metre, 1.0)
        )
        end = corner + (self._frame + BORDER) / metre
        self._layout.reset_limits(corner - BORDER / metre, end)
        middle = corner + 0.5 * self._frame / metre
        self._layout.reset_main_viewport(middle, (self._frame + 2.0 * BORDER) / metre)

    def add_viewport(self) -> None:
        """Show the building."""
        view = self._paper.view
        attributes = {"layer": SHEET_LAYER}
        self._layout.add_viewport(self._middle, view, self._middle, view[1], dxfattribs=attributes)

    def add_title(self, drawing: Drawing) -> None:
        """Draw frame and title, a scale bar and the map's y axis."""
        width, height = self._frame.tolist()
        bar = round_length(0.2 * self._paper.view[0])
        right = width - 10.0
        end = width - 24.0
        start = end - bar * self._metre
        border_x = [0.0, width, width, 0.0, 0.0]
        border_y = [0.0, 0.0, height, height, 0.0]
        self._add_line(border_x, border_y)
        self._add_line([0.0, width], [TITLE, TITLE])
        self._add_line([start, start, end, end], [11.0, 9.0, 9.0, 11.0])
        arrow_x = [right, right, right - 1.5, right + 1.5, right]
        arrow_y = [5.0, 17.0, 13.0, 13.0, 17.0]
        self._add_line(arrow_x, arrow_y)
        area = f"{drawing.area:.1f} m² of floor"
        rooms = counted(len(drawing.rooms), "room")
        scale = f"1:{self._paper.scale} on {self._paper.name}"
        made_by = f"slamgym {drawing.provenance.get('slamgym', '')}"
        self._add_text(4.0, 14.0, drawing.name[:40], letters=5.0)
        self._add_text(4.0, 8.5, f"{area}, {rooms}; {scale}")
        self._add_text(4.0, 3.5, f"Lengths in metres, drawn from a robot's map by {made_by}")
        self._add_text(start, 4.0, f"{bar:g} m")
        self._add_text(right + 2.0, 5.0, "y")

    def _add_line(self, x: list[float], y: list[float]) -> None:
        """A line through points from the corner [mm]."""
        places = self._corner + np.column_stack([x, y]) / self._metre
        self._layout.add_lwpolyline(places, dxfattribs={"layer": SHEET_LAYER})

    def _add_text(self, x: float, y: float, words: str, letters: float = 2.5) -> None:
        """Words at a place from the corner, with letters of a height [mm]."""
        place = self._corner + np.array([x, y]) / self._metre
        height = letters / self._metre
        add_text(self._layout, words, place, height, SHEET_LAYER)


def add_text(
    space: Any, words: str, at: Any, height: float, layer: str, align: str = "LEFT"
) -> None:
    """A line of text at a point."""
    from ezdxf.enums import TextEntityAlignment

    attributes = {"style": "PLAN", "layer": layer}
    text = space.add_text(words, height=height, dxfattribs=attributes)
    text.set_placement(tuple(at), align=TextEntityAlignment[align])
