"""Context in the bird's-eye view: a small U-Net, since an object covers more than the cell of its centre."""

from beartype import beartype
from torch import Tensor, nn

from fusion_net.models.blocks.layers import ConvBlock, ResidualBlock, UpBlock


@beartype
class BEVDecoder(nn.Module):
    """(B, channels, Y, X) to the same shape by way of half and quarter resolution, ``half`` and ``quarter`` channels wide.

    On two cores these convolutions are most of a training step, and one at full resolution costs four at half, so the
    width grows only below full resolution.
    """

    def __init__(self, *, channels: int, half: int, quarter: int) -> None:
        super().__init__()
        self.fine = ConvBlock(channels, channels)
        self.middle = nn.Sequential(ConvBlock(channels, half, stride=2), ResidualBlock(half))
        self.coarse = nn.Sequential(ConvBlock(half, quarter, stride=2), ResidualBlock(quarter), ResidualBlock(quarter))
        self.to_middle = UpBlock(deep=quarter, shallow=half, outputs=half)
        self.to_fine = UpBlock(deep=half, shallow=channels, outputs=channels)

    def forward(self, fused: Tensor) -> Tensor:
        """Fused map in, decoded map of the same resolution out."""
        fine = self.fine(fused)
        middle = self.middle(fine)
        return self.to_fine(self.to_middle(self.coarse(middle), middle), fine)
