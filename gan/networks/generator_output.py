"""What a generator draws."""

from typing import NamedTuple

from torch import Tensor


class Drawing(NamedTuple):
    """The output of a generator."""

    image: Tensor  # (B, out, R, R) in [-1, 1]
    logits: Tensor | None = None
    """Log odds of each value being 1 instead of -1, so that ``image = tanh(logits / 2)``; same shape. None while
    two resolutions are blended."""
    field: Tensor | None = None
    """Predicted displacement (B, 2, H', W') [px of the input], component 0 to the right, 1 upwards; see
    :mod:`slamgym.gan.networks.displacement`."""
