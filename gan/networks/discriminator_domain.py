"""The domain judge: does this output belong to this input? Global, on several scales."""

from torch import Tensor, nn
from torch.nn import functional

from slamgym.gan.networks.discriminator_body import DiscriminatorBody, copy_depths, pair_with


class DomainDiscriminator(nn.Module):
    """Three copies that see the pair in full, at a quarter and at a sixteenth of the resolution.

    Each makes one judgement of the whole pair (anime2clothing's ``PG_MultiScale``): 4,112,928 weights for two RGB
    images at 256 px.
    """

    def __init__(self, in_channels: int, out_channels: int, resolution: int = 256, width: int = 128) -> None:
        super().__init__()
        self.copies = nn.ModuleList(
            DiscriminatorBody(in_channels + out_channels, depth, width) for depth in copy_depths(resolution)
        )

    def forward(self, x: Tensor, y: Tensor, fade: float = 1.0) -> list[list[Tensor]]:
        """Judge pairs.

        Args:
            x: Inputs at the output's size, (B, in, R, R).
            y: Outputs or targets, (B, out, R, R).
            fade: As in :meth:`DiscriminatorBody.forward`.

        Returns:
            For each copy its features, the last one the judgements (B, 1, 1, 1).
        """
        pair = pair_with(x, y)
        resolution = y.shape[-1]
        depths = copy_depths(resolution, fade)
        return [
            copy(functional.avg_pool2d(pair, resolution // depth), depth, fade)
            for copy, depth in zip(self.copies, depths, strict=False)
        ]
