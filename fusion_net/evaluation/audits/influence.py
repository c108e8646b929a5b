"""Whether a network listens to each sensor: size of its map and of the loss's gradient there."""

from collections.abc import Iterable

import torch
from torch import Tensor, nn

from fusion_net.data.batch import Batch
from fusion_net.models.blocks.outputs import Encoded
from fusion_net.models.fusion_net import FusionNet


def influence(model: FusionNet, batches: Iterable[Batch]) -> dict[str, dict[str, float]]:
    """Of each encoder, over all cells of its maps: the root mean square of the ``activation``; that of the ``gradient`` of the
    detection losses there, as a share of all encoders' sum; and the ``share`` of all sensors' sum of abs(activation x
    gradient), which says how much of the prediction would go with the map, to first order (Simonyan et al. 2014, arXiv
    1312.6034). Weights are not changed."""
    sums = {name: torch.zeros(3, dtype=torch.float64) for name in model.encoders}
    count = dict.fromkeys(model.encoders, 0)
    for batch in batches:
        for name, (value, gradient) in _maps_and_gradients(model, batch).items():
            value, gradient = value.double(), gradient.double()
            sums[name] += torch.stack(
                [value.square().sum(), gradient.square().sum(), (value * gradient).abs().sum()]
            ).cpu()
            count[name] += value.numel()
    square = {name: (total / max(count[name], 1)).sqrt() for name, total in sums.items()}
    gradients = max(sum(float(mean[1]) for mean in square.values()), 1e-30)
    whole = max(sum(float(total[2]) for total in sums.values()), 1e-30)
    return {
        name: {
            "activation": float(square[name][0]),
            "gradient": float(square[name][1]) / gradients,
            "share": float(total[2]) / whole,
        }
        for name, total in sums.items()
    }


def _maps_and_gradients(model: FusionNet, batch: Batch) -> dict[str, tuple[Tensor, Tensor]]:
    """Each encoder's map (B, C, Y, X) of one batch and the gradient of the loss there; of absent sensors nothing."""
    maps: dict[str, Tensor] = {}

    def keep(name: str):
        def hook(_: nn.Module, __: tuple, encoded: Encoded) -> Encoded:
            maps[name] = encoded.bev.detach().requires_grad_()  # a leaf: nothing is to be learned before it
            return Encoded(maps[name], encoded.image)

        return hook

    handles = [encoder.register_forward_hook(keep(name)) for name, encoder in model.encoders.items()]
    try:
        with torch.enable_grad():
            loss = model.loss(model(batch), batch)["loss"]
            gradients = torch.autograd.grad(loss, list(maps.values()), allow_unused=True)
    finally:
        for handle in handles:
            handle.remove()
    return {
        name: (value.detach(), torch.zeros_like(value) if gradient is None else gradient)
        for (name, value), gradient in zip(maps.items(), gradients, strict=True)
    }
