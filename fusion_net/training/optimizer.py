"""Muon for the convolutions, AdamW for the rest: the same accuracy in far fewer steps, and steps are what two cores lack."""

from collections.abc import Callable, Iterable, Sequence

import torch
from torch import Tensor, nn

_QUINTIC = (3.4445, -4.7750, 2.0315)
"""Coefficients of the Newton-Schulz iteration: the steepest at 0 that still ends near 1 (Jordan et al. 2024)."""
_ITERATIONS = 5
_LEAST_RANK = 16
"""Rows or columns below which a matrix is left to AdamW: there is little to make orthogonal."""


def orthogonalized(matrices: Sequence[Tensor]) -> list[Tensor]:
    """Nearly the orthogonal factor U V^T of each matrix (R, C) = U S V^T; singular values come out between 0.7 and 1.2.

    The iteration X <- (a + b G + c G^2) X with G = X X^T multiplies X by polynomials of its own Gram matrix, which commute.
    So it is run on the small G alone, those of one size stacked, and X is multiplied once, at the end. In float32: squared
    singular values need its digits.
    """
    a, b, c = _QUINTIC
    wide = [x if x.shape[0] <= x.shape[1] else x.T for x in matrices]
    factors: dict[int, Tensor] = {}
    for rows in {len(x) for x in wide}:
        chosen = [i for i, x in enumerate(wide) if len(x) == rows]
        gram = torch.stack([wide[i] @ wide[i].T for i in chosen])
        squared_norm = gram.diagonal(dim1=1, dim2=2).sum(dim=1).clamp(min=1e-14)[:, None, None]
        gram = gram / squared_norm
        factor = torch.eye(rows, device=gram.device).expand_as(gram) / squared_norm.sqrt()
        for _ in range(_ITERATIONS):
            polynomial = torch.baddbmm(gram, gram, gram, beta=b, alpha=c)
            polynomial.diagonal(dim1=1, dim2=2).add_(a)
            factor = polynomial @ factor
            gram = gram @ (polynomial @ polynomial)
        factors |= dict(zip(chosen, factor, strict=True))
    made = [factors[i] @ x for i, x in enumerate(wide)]
    return [new if x is matrix else new.T for new, x, matrix in zip(made, wide, matrices, strict=True)]


class MuonAdamW(torch.optim.AdamW):
    """AdamW whose groups with ``muon=True`` take steps of Muon instead (K. Jordan et al. 2024, "Muon: an optimizer for
    hidden layers in neural networks"): Nesterov momentum, made orthogonal, with every kernel read as a matrix of outputs
    against inputs x window. A step is scaled to the root mean square of AdamW's (Liu et al. 2025, "Muon is scalable for
    LLM training"), so that both kinds share one learning rate.
    """

    def __init__(self, groups: Iterable[dict], *, lr: float, momentum: float = 0.95) -> None:
        super().__init__([{"muon": False, "momentum": momentum, **group} for group in groups], lr=lr, fused=True)
        self._step_supports_amp_scaling = False  # bfloat16 needs no loss scaling, and with it Lightning refuses to clip

    @torch.no_grad()
    def step(self, closure: Callable[[], float] | None = None) -> float | None:  # type: ignore[override]
        """One step of every group."""
        loss = None
        if closure is not None:
            with torch.enable_grad():
                loss = closure()
        groups = self.param_groups
        for group in groups:
            if group["muon"]:
                self._step_muon([p for p in group["params"] if p.grad is not None], group)
        self.param_groups = [group for group in groups if not group["muon"]]
        try:
            super().step()
        finally:
            self.param_groups = groups
        return loss

    def _step_muon(self, parameters: list[Tensor], group: dict) -> None:
        if not parameters:
            return
        for parameter in parameters:
            if not self.state[parameter]:
                self.state[parameter]["momentum_buffer"] = torch.zeros_like(parameter)
                self.state[parameter]["step"] = torch.zeros(())  # AdamW looks for it when it loads a state
        grads = [p.grad for p in parameters if p.grad is not None]
        averages = [self.state[p]["momentum_buffer"] for p in parameters]
        torch._foreach_lerp_(averages, grads, 1 - group["momentum"])
        ahead = torch._foreach_lerp(grads, averages, group["momentum"])
        steps = orthogonalized([x.flatten(1) for x in ahead])
        torch._foreach_mul_(parameters, 1 - group["lr"] * group["weight_decay"])
        for parameter, step in zip(parameters, steps, strict=True):
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
