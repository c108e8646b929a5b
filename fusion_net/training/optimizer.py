"""Muon for the convolutions, AdamW for the rest: the same accuracy in far fewer steps, and steps are what two cores lack."""

from collections.abc import Callable, Iterable

import torch
from torch import Tensor, nn

_QUINTIC = (3.4445, -4.7750, 2.0315)
"""Coefficients of the Newton-Schulz iteration: the steepest at 0 that still ends near 1 (Jordan et al. 2024)."""
_ITERATIONS = 5
_LEAST_RANK = 16
"""Rows or columns below which a matrix is left to AdamW: there is little to make orthogonal."""


def orthogonalized(matrix: Tensor) -> Tensor:
    """Nearly the orthogonal factor U V^T of ``matrix`` (R, C) = U S V^T; its singular values come out between 0.7 and 1.2."""
    a, b, c = _QUINTIC
    wide = matrix if matrix.shape[0] <= matrix.shape[1] else matrix.T
    x = wide.bfloat16() / wide.norm().clamp(min=1e-7)
    for _ in range(_ITERATIONS):
        gram = x @ x.T
        x = torch.addmm(x, torch.addmm(gram, gram, gram, beta=b, alpha=c), x, beta=a)
    return (x if wide is matrix else x.T).to(matrix.dtype)


class MuonAdamW(torch.optim.AdamW):
    """AdamW whose groups with ``muon=True`` take steps of Muon instead (K. Jordan et al. 2024, "Muon: an optimizer for
    hidden layers in neural networks"): Nesterov momentum, made orthogonal, with every kernel read as a matrix of outputs
    against inputs x window. A step is scaled to the root mean square of AdamW's (Liu et al. 2025, "Muon is scalable for
    LLM training"), so that both kinds share one learning rate.
    """

    def __init__(self, groups: Iterable[dict], *, lr: float, momentum: float = 0.95) -> None:
        super().__init__([{"muon": False, "momentum": momentum, **group} for group in groups], lr=lr)

    @torch.no_grad()
    def step(self, closure: Callable[[], float] | None = None) -> float | None:  # type: ignore[override]
        """One step of every group."""
        loss = None
        if closure is not None:
            with torch.enable_grad():
                loss = closure()
        groups = self.param_groups
        for group in groups:
            for parameter in group["params"] if group["muon"] else ():
                if parameter.grad is not None:
                    self._step_muon(parameter, parameter.grad, group)
        self.param_groups = [group for group in groups if not group["muon"]]
        try:
            super().step()
        finally:
            self.param_groups = groups
        return loss

    def _step_muon(self, parameter: Tensor, grad: Tensor, group: dict) -> None:
        state = self.state[parameter]
        if not state:
            state["momentum_buffer"] = torch.zeros_like(parameter)
            state["step"] = torch.zeros(())  # AdamW looks for it when it loads a state
        average = state["momentum_buffer"].lerp_(grad, 1 - group["momentum"])
        step = orthogonalized(torch.lerp(grad, average, group["momentum"]).flatten(1))
        parameter.mul_(1 - group["lr"] * group["weight_decay"])
        parameter.sub_(step.view_as(parameter), alpha=group["lr"] * 0.2 * max(step.shape) ** 0.5)


def make_optimizer(model: nn.Module, *, outputs: Iterable[nn.Module], lr: float, weight_decay: float) -> MuonAdamW:
    """Kernels to Muon; AdamW for what is small, for the last layers ``outputs``, whose rows mean different things, and for
    norms and biases, which do not decay."""
    last = {id(layer.weight) for layer in outputs}
    kernels = [p for p in model.parameters() if p.ndim > 1]
    hidden = [p for p in kernels if min(len(p), p[0].numel()) > _LEAST_RANK and id(p) not in last]
    chosen = {id(p) for p in hidden}
    groups = [
        {"params": hidden, "weight_decay": weight_decay, "muon": True},
        {"params": [p for p in kernels if id(p) not in chosen], "weight_decay": weight_decay},
        {"params": [p for p in model.parameters() if p.ndim <= 1], "weight_decay": 0.0},
    ]
    return MuonAdamW(groups, lr=lr)
