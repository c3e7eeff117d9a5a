"""Undoing drift inside a network: a predicted displacement field and the layer that warps by it.

Convention (as in ``slamgym.parametric.warp``, but in pixels): a field has shape (B, 2, H, W), component 0 to the right,
1 upwards, and the warp samples ``out(q) = in(q + d(q))``; so a constant d of +3 in component 0 moves the image 3 pixels
to the left, and +3 in component 1 moves it down.
"""

import torch
from torch import Tensor
from torch.nn import functional


def warp(features: Tensor, field: Tensor) -> Tensor:
    """Pull features through a field, bilinearly; what comes from beyond the border repeats it.

    Args:
        features: (B, C, H, W).
        field: (B, 2, H, W) [px of ``features``].

    Returns:
        (B, C, H, W) of the features' type.
    """
    rows, cols = features.shape[-2:]
    field = field.float()
    step_x = torch.linspace(-1.0 + 1.0 / cols, 1.0 - 1.0 / cols, cols, device=field.device)
    step_y = torch.linspace(-1.0 + 1.0 / rows, 1.0 - 1.0 / rows, rows, device=field.device)
    # grid_sample's axes: x to the right, y downwards, -1 and 1 on the outer borders of the image.
    grid = torch.stack(
        [step_x + field[:, 0] * (2.0 / cols), step_y[:, None] - field[:, 1] * (2.0 / rows)], dim=-1
    )
    return functional.grid_sample(
        features, grid.to(features.dtype), mode="bilinear", padding_mode="border", align_corners=False
    )


def resize_field(field: Tensor, side: int, input_size: int) -> Tensor:
    """Give a field in input pixels the size and the pixels of a feature level.

    Args:
        field: (B, 2, h, w) [px of the input].
        side: Side of the level [px].
        input_size: Side of the input [px].

    Returns:
        (B, 2, side, side) [px of the level].
    """
    scaled = field.float() * (side / input_size)
    if field.shape[-1] == side:
        return scaled
    return functional.interpolate(scaled, size=(side, side), mode="bilinear", align_corners=False)


def roughness(field: Tensor) -> Tensor:
    """Mean squared difference of neighbouring vectors: 0 for a constant field. Scalar."""
    field = field.float()
    along_x = (field[..., :, 1:] - field[..., :, :-1]).square().mean()
    along_y = (field[..., 1:, :] - field[..., :-1, :]).square().mean()
    return along_x + along_y
