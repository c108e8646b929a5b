"""Which device an accelerator is, and the number format there."""

import pytest
import torch

from fusion_net.models.precision import device_of, resolve


def test_auto_takes_a_gpu_where_there_is_one():
    assert device_of("auto", setting="accelerator") == ("cuda" if torch.cuda.is_available() else "cpu")
    assert device_of("cpu", setting="accelerator") == "cpu"


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_a_gpu_that_is_not_there_is_refused_with_what_to_pass():
    with pytest.raises(ValueError, match=r"^accelerator=gpu: there is no GPU here; pass accelerator=cpu$"):
        device_of("gpu", setting="accelerator")


def test_a_number_format_that_is_unknown_is_refused():
    with pytest.raises(ValueError, match=r"^trainer\.precision=bf17; there are auto, bf16, float32$"):
        resolve("bf17")
