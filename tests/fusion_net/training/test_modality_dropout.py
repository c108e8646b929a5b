import pytest
import torch

from fusion_net.training.modality_dropout import PROPER_SUBSETS, sample_present


def test_subsets_are_the_six_that_keep_and_drop_something():
    assert len({tuple(s) for s in PROPER_SUBSETS.tolist()}) == 6
    assert set(PROPER_SUBSETS.sum(dim=1).tolist()) == {1, 2}


@pytest.mark.parametrize(("probability", "share"), [(0.0, 0.0), (0.3, 0.3), (1.0, 1.0)])
def test_share_of_dropped_samples_is_the_probability(probability, share):
    present = sample_present(20_000, probability, torch.Generator().manual_seed(1))
    assert present.any(dim=1).all()
    assert (~present.all(dim=1)).float().mean().item() == pytest.approx(share, abs=0.015)


def test_each_subset_is_as_likely_and_drawn_a_sample():
    present = sample_present(30_000, 1.0, torch.Generator().manual_seed(2))
    counts = torch.unique(present, dim=0, return_counts=True)[1]
    assert len(counts) == 6
    assert (counts.float() / 30_000 - 1 / 6).abs().max() < 0.01


def test_same_generator_state_draws_the_same():
    first, second = (sample_present(64, 0.5, torch.Generator().manual_seed(3)) for _ in range(2))
    assert torch.equal(first, second)
