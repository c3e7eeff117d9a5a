"""The sheet of a DXF drawing: paper space with a viewport to scale, a title, a scale bar and the map's y axis."""

from typing import Any, NamedTuple

import numpy as np

from slamgym.core.progress import counted
from slamgym.core.types import FloatArray
from slamgym.drawing.drawing import Drawing
from slamgym.drawing.formats.svg import LETTERS
from slamgym.viz.canvas import round_length

BORDER, TITLE = 10.0, 22.0
"""Margin of the paper, and height of the strip with the title [mm]."""


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
        width, height = self.width - 2.0 * BORDER, self.height - 2.0 * BORDER - TITLE
        return 1e-3 * width * self.scale, 1e-3 * height * self.scale


def fitting_paper(width: float, height: float) -> Paper:
    """The smallest paper for a drawing so wide and high [m] to 1:50 or 1:100; A0 to a smaller scale if need be."""
    from ezdxf.addons.drawing.layout import PAGE_SIZES

    choices = [(size, scale) for size in ("A4", "A3", "A2", "A1", "A0") for scale in (50, 100)]
    for size, scale in [
        *choices,
        *(("A0", scale) for scale in (200, 500, 1000, 2000, 5000, 10_000)),
    ]:
        longer, shorter, _ = PAGE_SIZES[f"ISO {size}"]
        across, up = (longer, shorter) if width > height else (shorter, longer)
        paper = Paper(size, across, up, scale)
        if max(width / paper.view[0], height / paper.view[1]) < 0.98:
            break
    return paper


def add_sheet(document: Any, drawing: Drawing, paper: Paper, middle: FloatArray) -> None:
    """Draw the sheet round a middle (2,) [m] as the layout, in the building's coordinates, plotted to scale.

    Programs that don't know paper space show it round the building, where it belongs.
    """
    name = f"{paper.name} 1-{paper.scale}"
    document.layouts.rename("Layout1", name)
    layout, metre = document.layout(name), 1000.0 / paper.scale
    frame = np.array([paper.width, paper.height]) - 2.0 * BORDER
    corner = middle - 0.5 * (frame + np.array([0.0, TITLE])) / metre
    margins, offset = (BORDER,) * 4, tuple(-metre * corner)
    layout.page_setup((paper.width, paper.height), margins, offset=offset, scale=(metre, 1.0))
    layout.reset_limits(corner - BORDER / metre, corner + (frame + BORDER) / metre)
    layout.reset_main_viewport(corner + 0.5 * frame / metre, (frame + 2.0 * BORDER) / metre)
    layout.add_viewport(
        middle, paper.view, middle, paper.view[1], dxfattribs={"layer": "A-ANNO-TTLB"}
    )
    (width, height), bar = frame.tolist(), round_length(0.2 * paper.view[0])
    right, end = width - 10.0, width - 24.0
    start = end - bar * metre
    for points in (
        [(0.0, 0.0), (width, 0.0), (width, height), (0.0, height), (0.0, 0.0)],
        [(0.0, TITLE), (width, TITLE)],
        [(start, 11.0), (start, 9.0), (end, 9.0), (end, 11.0)],
        [(right, 5.0), (right, 17.0), (right - 1.5, 13.0), (right + 1.5, 13.0), (right, 17.0)],
    ):
        layout.add_lwpolyline(
            corner + np.array(points) / metre, dxfattribs={"layer": "A-ANNO-TTLB"}
        )
    facts = f"{drawing.area:.1f} m² of floor, {counted(len(drawing.rooms), 'room')}; 1:{paper.scale} on {paper.name}"
    origin = f"Lengths in metres, drawn from a robot's map by slamgym {drawing.provenance.get('slamgym', '')}"
    texts = [(4.0, 14.0, 5.0, drawing.name[:40]), (4.0, 8.5, 2.5, facts), (4.0, 3.5, 2.5, origin)]
    for x, y, letters, words in [
        *texts,
        (start, 4.0, 2.5, f"{bar:g} m"),
        (right + 2.0, 5.0, 2.5, "y"),
    ]:
        add_text(layout, words, corner + np.array([x, y]) / metre, letters / metre, "A-ANNO-TTLB")


def add_text(
    space: Any, words: str, at: Any, height: float, layer: str, align: str = "LEFT"
) -> None:
    """A line of text at a point."""
    from ezdxf.enums import TextEntityAlignment

    text = space.add_text(words, height=height, dxfattribs={"style": "PLAN", "layer": layer})
    text.set_placement(tuple(at), align=TextEntityAlignment[align])
