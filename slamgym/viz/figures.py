"""Pictures of an evaluation: grids of maps, overlays of errors, and the box plot of the paper's Fig. 6."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from slamgym.core.errors import SlamgymError
from slamgym.core.files import staged
from slamgym.core.types import BoolArray, ByteArray, FloatArray

PANEL_PX = 256
GAP_PX = 10
TITLE_PX = 30
CAPTION_PX = 20
ROWS_IN_A_BLOCK = 8
MAX_COLUMNS_OF_TWO_BLOCKS = 6

_PAPER, _INK, _QUIET = (255, 255, 255), (38, 43, 51), (110, 118, 129)
_BOTH, _MISSING, _EXTRA = (255, 255, 255), (60, 130, 220), (220, 60, 50)


def draw_grid(
    columns: Sequence[str], rows: Sequence[Sequence[ByteArray]], captions: Sequence[str] | None = None
) -> ByteArray:
    """Draw pictures in a grid with a title over each column; many rows of few columns stand in two blocks.

    Args:
        columns: Titles.
        rows: Each with one picture per column: (H, W) grey or (H, W, 3) RGB, any size.
        captions: A line under each row.

    Returns:
        RGB, shape (rows, cols, 3).
    """
    if len(rows) > ROWS_IN_A_BLOCK and len(columns) <= MAX_COLUMNS_OF_TWO_BLOCKS:
        half = -(-len(rows) // 2)
        blocks = [_draw_block(columns, rows[i : i + half], (captions or [])[i : i + half]) for i in (0, half)]
        height = max(block.shape[0] for block in blocks)
        padded = [np.pad(b, ((0, height - b.shape[0]), (0, 0), (0, 0)), constant_values=255) for b in blocks]
        return np.hstack([padded[0], np.full((height, 2 * GAP_PX, 3), 255, np.uint8), padded[1]])
    return _draw_block(columns, rows, captions or [])


def _draw_block(
    columns: Sequence[str], rows: Sequence[Sequence[ByteArray]], captions: Sequence[str]
) -> ByteArray:
    line = PANEL_PX + GAP_PX + (CAPTION_PX if captions else 0)
    width = len(columns) * (PANEL_PX + GAP_PX) + GAP_PX
    sheet = Image.new("RGB", (width, TITLE_PX + len(rows) * line + GAP_PX), _PAPER)
    pen = ImageDraw.Draw(sheet)
    for number, title in enumerate(columns):
        pen.text((GAP_PX + number * (PANEL_PX + GAP_PX), 7), title, fill=_INK, font=_font(15))
    for i, row in enumerate(rows):
        top = TITLE_PX + i * line
        for number, picture in enumerate(row):
            panel = _fit(_rgb(picture))
            left = GAP_PX + number * (PANEL_PX + GAP_PX)
            offset_y, offset_x = (PANEL_PX - panel.shape[0]) // 2, (PANEL_PX - panel.shape[1]) // 2
            sheet.paste(Image.fromarray(panel), (left + offset_x, top + offset_y))
            pen.rectangle((left - 1, top - 1, left + PANEL_PX, top + PANEL_PX), outline=(225, 228, 232))
        if captions:
            pen.text((GAP_PX, top + PANEL_PX + 3), captions[i], fill=_QUIET, font=_font(12))
    return np.asarray(sheet, dtype=np.uint8).copy()


def draw_overlay(free: BoolArray, truth: BoolArray) -> ByteArray:
    """The agreement of two masks: white free in both, red only in the map, blue only in the CAD map.

    Args:
        free: (H, W), placed on the truth.
        truth: (H, W).

    Returns:
        RGB, shape (H, W, 3).
    """
    picture = np.zeros((*truth.shape, 3), dtype=np.uint8)
    picture[free & truth] = _BOTH
    picture[truth & ~free] = _MISSING
    picture[free & ~truth] = _EXTRA
    return picture


def write_picture(path: Path, picture: ByteArray) -> None:
    """Write an RGB or grey picture as PNG, whole or not at all."""
    with staged(path) as part:
        Image.fromarray(picture).save(part, format="PNG", optimize=True)


def write_box_plot(path: Path, differences: dict[str, FloatArray]) -> None:
    """The box plot of the paper's Fig. 6: MSE2 - MSE1 of every map, one box per method; positive is better.

    Args:
        path: PNG file.
        differences: By method, shape (N,).

    Raises:
        SlamgymError: If matplotlib isn't installed.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ModuleNotFoundError as error:
        raise SlamgymError(
            "the box plot needs matplotlib; install the extra: pip install 'slamgym[gan]'"
        ) from error
    figure = Figure(figsize=(7.0, 1.2 + 0.62 * len(differences)), dpi=150)
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.boxplot(
        list(differences.values())[::-1],
        orientation="horizontal",
        widths=0.55,
        showmeans=True,
        medianprops={"color": "#1f5fa8", "linewidth": 1.6},
        meanprops={"marker": "D", "markerfacecolor": "#d9822b", "markeredgecolor": "none", "markersize": 5},
        flierprops={"marker": ".", "markersize": 3, "alpha": 0.5},
    )
    axes.set_yticks(range(1, len(differences) + 1), list(differences)[::-1])
    axes.axvline(0.0, color="0.5", linewidth=0.8, linestyle="--")
    axes.set_xlabel("MSE2 - MSE1 (positive: nearer to the CAD map than the SLAM map is)")
    axes.spines[["top", "right"]].set_visible(False)
    figure.tight_layout()
    with staged(path) as part:
        figure.savefig(part, format="png")


def _rgb(picture: ByteArray) -> ByteArray:
    return np.repeat(picture[:, :, None], 3, axis=2) if picture.ndim == 2 else picture


def _fit(picture: ByteArray) -> ByteArray:
    """Scale to a panel: sharp when it grows, averaged when it shrinks."""
    scale = PANEL_PX / max(picture.shape[:2])
    size = (max(1, round(picture.shape[1] * scale)), max(1, round(picture.shape[0] * scale)))
    method = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_NEAREST
    return np.asarray(cv2.resize(picture, size, interpolation=method), dtype=np.uint8)


def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)
