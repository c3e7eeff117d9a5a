"""One picture of many rendered pairs: CAD and SLAM side by side."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from slamgym.core.types import ByteArray
from slamgym.dataset.images.format import ImageRecord, load_images

GAP_PX = 12
CAPTION_PX = 34
_PAPER = (255, 255, 255)
_INK = (38, 43, 51)
_FRAME = (176, 182, 190)


def draw_image_sheet(root: Path | str, records: Sequence[ImageRecord], columns: int) -> ByteArray:
    """Draw rendered pairs as they are, with their names.

    Args:
        root: The folder of images.
        records: The pairs, drawn row by row.
        columns: Pairs beside each other.

    Returns:
        The picture, shape (rows, cols, 3), RGB.

    Raises:
        InputFileError: If an image is missing or malformed.
    """
    columns = max(1, min(columns, len(records)))
    side = max(record.size for record in records)
    card = 2 * side + GAP_PX
    rows = -(-len(records) // columns)
    width = columns * (card + 2 * GAP_PX) + GAP_PX
    sheet = Image.new("RGB", (width, rows * (side + CAPTION_PX + GAP_PX) + GAP_PX), _PAPER)
    pen = ImageDraw.Draw(sheet)
    font = ImageFont.load_default(13)
    for number, record in enumerate(records):
        row, column = divmod(number, columns)
        left = GAP_PX + column * (card + 2 * GAP_PX)
        top = GAP_PX + row * (side + CAPTION_PX + GAP_PX)
        for place, image in enumerate(load_images(root, record)):
            x = left + place * (side + GAP_PX)
            sheet.paste(Image.fromarray(image), (x, top))
            pen.rectangle([x - 1, top - 1, x + record.size, top + record.size], outline=_FRAME)
        caption = f"{record.split}  {record.name[:40]}  {record.metres_per_px:.3f} m/px"
        pen.text((left, top + side + 6), caption, fill=_INK, font=font)
    return np.asarray(sheet, dtype=np.uint8).copy()
