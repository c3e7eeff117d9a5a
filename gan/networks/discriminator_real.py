"""The real/fake judge: do the patches of this image look like a target? Several patch sizes."""

from torch import Tensor, nn

from slamgym.gan.networks.discriminator_body import DiscriminatorBody, copy_depths


class RealFakeDiscriminator(nn.Module):
    """Three copies of different depth, all on the full image: 1 x 1, 13 x 13 and 61 x 61 judgements at 256 px.

    anime2clothing's ``PG_MultiPatch``: 4,108,176 weights for RGB at 256 px. The second and third copy run at full
    resolution with the channels of a deeper level, so nearly all of the cost is theirs; ``patch_width`` narrows them.
    """

    def __init__(
        self, channels: int, resolution: int = 256, width: int = 128, patch_width: int = 128
    ) -> None:
        super().__init__()
        first, *patches = copy_depths(resolution)
        self.copies = nn.ModuleList(
            [
                DiscriminatorBody(channels, first, width),
                *(DiscriminatorBody(channels, depth, patch_width) for depth in patches),
            ]
        )

    def forward(self, y: Tensor, fade: float = 1.0) -> list[list[Tensor]]:
        """Judge images.

        Args:
            y: Outputs or targets, (B, C, R, R).
            fade: As in :meth:`DiscriminatorBody.forward`.

        Returns:
            For each copy its features, the last one the judgements (B, 1, P, P).
        """
        depths = copy_depths(y.shape[-1], fade)
        return [copy(y, depth, fade) for copy, depth in zip(self.copies, depths, strict=False)]
