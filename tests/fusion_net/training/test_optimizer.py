import copy

import pytest
import torch
from torch import nn

from fusion_net.training.optimizer import MuonAdamW, make_optimizer, orthogonalized


def small_net():
    torch.manual_seed(3)
    return nn.Sequential(nn.Conv2d(3, 24, 3), nn.BatchNorm2d(24), nn.Conv2d(24, 32, 3), nn.Conv2d(32, 5, 1))


def train(model, optimizer, steps):
    torch.manual_seed(7)
    for _ in range(steps):
        optimizer.zero_grad()
        model(torch.randn(2, 3, 8, 9)).square().mean().backward()
        optimizer.step()


@pytest.mark.parametrize("shape", [(24, 90), (90, 24), (32, 32)])
def test_singular_values_come_out_near_one_and_directions_stay(shape):
    torch.manual_seed(1)
    matrix = torch.randn(shape) * 1e-3
    (result,) = orthogonalized([matrix])
    values = torch.linalg.svdvals(result)
    assert values.min() > 0.5
    assert values.max() < 1.35
    u, _, v = torch.linalg.svd(matrix, full_matrices=False)
    assert (result * (u @ v)).sum() / min(shape) > 0.8  # the orthogonal factor itself has 1


def test_every_parameter_is_in_one_group_and_hidden_kernels_go_to_muon():
    model = small_net()
    optimizer = make_optimizer(model, outputs=[model[3]], lr=1e-3, weight_decay=0.1)
    listed = [p for group in optimizer.param_groups for p in group["params"]]
    assert sorted(map(id, listed)) == sorted(map(id, model.parameters()))
    assert [id(p) for p in optimizer.param_groups[0]["params"]] == [id(model[0].weight), id(model[2].weight)]
    assert [group["weight_decay"] for group in optimizer.param_groups] == [0.1, 0.1, 0.0]


def test_a_muon_step_is_as_long_as_an_adam_step():
    kernel = nn.Parameter(torch.zeros(48, 32, 3, 3).to(memory_format=torch.channels_last))
    torch.manual_seed(2)
    kernel.grad = torch.randn_like(kernel)
    MuonAdamW([{"params": [kernel], "muon": True, "weight_decay": 0.0}], lr=0.01).step()
    assert kernel.detach().square().mean().sqrt() == pytest.approx(0.2 * 0.01, rel=0.2)
    assert (kernel * kernel.grad).sum() < 0


def test_without_muon_it_is_adamw():
    one, two = small_net(), small_net()
    groups = [{"params": list(two.parameters()), "weight_decay": 0.01}]
    train(one, torch.optim.AdamW(one.parameters(), lr=1e-2, weight_decay=0.01, fused=True), 5)
    train(two, MuonAdamW(groups, lr=1e-2), 5)
    for a, b in zip(one.parameters(), two.parameters(), strict=True):
        torch.testing.assert_close(a, b, rtol=0, atol=0)


def test_saved_state_goes_on_exactly():
    model = small_net()
    optimizer = make_optimizer(model, outputs=[model[3]], lr=1e-2, weight_decay=0.01)
    train(model, optimizer, 3)
    other = copy.deepcopy(model)
    resumed = make_optimizer(other, outputs=[other[3]], lr=1e-2, weight_decay=0.01)
    resumed.load_state_dict(copy.deepcopy(optimizer.state_dict()))
    train(model, optimizer, 3)
    train(other, resumed, 3)
    for a, b in zip(model.parameters(), other.parameters(), strict=True):
        torch.testing.assert_close(a, b, rtol=0, atol=0)


def test_matrices_made_orthogonal_together_come_out_as_each_alone():
    torch.manual_seed(4)
    matrices = [torch.randn(shape) for shape in ((24, 90), (90, 24), (24, 24), (32, 60), (24, 90))]
    for together, matrix in zip(orthogonalized(matrices), matrices, strict=True):
        torch.testing.assert_close(together, orthogonalized([matrix])[0])


def test_a_kernel_of_zeros_stays_finite():
    assert orthogonalized([torch.zeros(24, 90)])[0].isfinite().all()
