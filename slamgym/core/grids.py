"""Laying one grid onto another."""

import numpy as np


def paste(canvas: np.ndarray, picture: np.ndarray, top: int, left: int) -> None:
    """Fill a canvas as far as a picture reaches; what lies beyond keeps its values.

    Args:
        canvas: Written to, shape (..., H, W).
        picture: Shape (..., rows, cols), with the same leading axes.
        top: Row of the picture at which the canvas begins; may be negative or beyond the picture.
        left: Its column there.
    """
    rows, cols = (
        slice(min(max(0, first), there), max(0, min(there, first + here)))
        for first, here, there in zip((top, left), canvas.shape[-2:], picture.shape[-2:], strict=True)
    )
    part = picture[..., rows, cols]
    canvas[..., rows.start - top :, cols.start - left :][..., : part.shape[-2], : part.shape[-1]] = part
