"""The sparse product against the outer product it replaces, in value and gradients."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion_net.models.blocks.splat import SplatIndex, splat


def naive(features, weights, pixel, cell, cells):
    """Outer product and scatter-add."""
    lifted = weights[:, None] * features[pixel]
    return features.new_zeros(cells, features.shape[1]).index_add(0, cell, lifted)


@settings(max_examples=30)
@given(st.integers(0, 40), st.integers(1, 9), st.integers(1, 7), st.integers(1, 6), st.integers(0, 1000))
def test_splat_equals_the_outer_product_in_value_and_gradients(entries, pixels, cells, channels, seed):
    rng = torch.Generator().manual_seed(seed)
    features = torch.randn(pixels, channels, generator=rng, dtype=torch.float64, requires_grad=True)
    weights = torch.rand(entries, generator=rng, dtype=torch.float64, requires_grad=True)
    pixel = torch.randint(0, pixels, (entries,), generator=rng)
    cell = torch.randint(0, cells, (entries,), generator=rng)
    grad = torch.randn(cells, channels, generator=rng, dtype=torch.float64)
    ours = splat(features, weights, SplatIndex.of(pixel, cell, pixels=pixels, cells=cells))
    theirs = naive(features, weights, pixel, cell, cells)
    torch.testing.assert_close(ours, theirs)
    for a, b in zip(
        torch.autograd.grad(ours, [features, weights], grad),
        torch.autograd.grad(theirs, [features, weights], grad),
        strict=True,
    ):
        torch.testing.assert_close(a, b)


def test_splat_gradcheck():
    rng = torch.Generator().manual_seed(3)
    features = torch.randn(5, 3, generator=rng, dtype=torch.float64, requires_grad=True)
    weights = torch.rand(17, generator=rng, dtype=torch.float64, requires_grad=True)
    index = SplatIndex.of(
        torch.randint(0, 5, (17,), generator=rng), torch.randint(0, 4, (17,), generator=rng), pixels=5, cells=4
    )
    assert torch.autograd.gradcheck(lambda f, w: splat(f, w, index), (features, weights))


def test_published_pooling_example():
    """The unit test of BEVDet's pooling operator: outputs sum to 4.4, gradients as published."""
    depth = torch.tensor([0.3, 0.4, 0.2, 0.1, 0.7, 0.6, 0.8, 0.9], requires_grad=True)  # (D = 2, h = 2, w = 2)
    features = torch.ones(4, 2, requires_grad=True)
    entry, pixel, cell = (torch.tensor(x) for x in ([0, 4, 1, 6], [0, 0, 1, 2], [0, 0, 1, 1]))
    out = splat(features, depth[entry], SplatIndex.of(pixel, cell, pixels=4, cells=2))
    out.sum().backward()
    assert out.sum().item() == pytest.approx(4.4)
    assert depth.grad.tolist() == [2, 2, 0, 0, 2, 0, 2, 0]
    torch.testing.assert_close(features.grad[:, 0], torch.tensor([1.0, 0.4, 0.8, 0.0]))


def test_splat_ignores_autocast():
    features, weights = torch.full((1, 1), 1.0), torch.full((300,), 1.0)
    index = SplatIndex.of(torch.zeros(300), torch.zeros(300), pixels=1, cells=1)
    with torch.autocast("cpu", torch.bfloat16):
        assert splat(features.bfloat16(), weights, index).item() == 300.0  # bfloat16 would stop counting at 256
