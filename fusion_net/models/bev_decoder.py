"""Context in the bird's-eye view: a small U-Net, since an object is more than the cell of its centre."""

from beartype import beartype
from torch import Tensor, nn

from fusion_net.models.layers import ConvBlock, ResidualBlock, UpBlock


@beartype
class BEVDecoder(nn.Module):
    """(B, inputs, Y, X) to (B, outputs, Y, X) by way of half and quarter resolution.

    On two cores these convolutions are most of a training step, and one at full resolution costs four at half, so the
    width grows only below it.
    """

    def __init__(self, *, inputs: int = 32, half: int = 96, quarter: int = 96, outputs: int = 32) -> None:
        super().__init__()
        self.fine = ConvBlock(inputs, outputs)
        self.middle = nn.Sequential(ConvBlock(outputs, half, stride=2), ResidualBlock(half))
        self.coarse = nn.Sequential(ConvBlock(half, quarter, stride=2), ResidualBlock(quarter), ResidualBlock(quarter))
        self.to_middle = UpBlock(deep=quarter, shallow=half, outputs=half)
        self.to_fine = UpBlock(deep=half, shallow=outputs, outputs=outputs)

    def forward(self, fused: Tensor) -> Tensor:
        """Fused map in, decoded map of the same resolution out."""
        fine = self.fine(fused)
        middle = self.middle(fine)
        return self.to_fine(self.to_middle(self.coarse(middle), middle), fine)
