"""Files of shipped weights: small, safe to load, and clear about what does not fit."""

import pytest
import torch

from fusion_net.models.weights_file import LARGEST, compact, fit_weights, read_weights, write_weights
from tests.fixtures.small_model import small_model

ABOUT = {"config": {"seed": 1}, "table": {"rows": []}, "manifest": [{"hash": "f"}], "record": {"steps": 3}}


def test_what_was_written_is_read_without_running_code(tmp_path):
    path, weights = tmp_path / "checkpoints/a.pt", compact(small_model().state_dict())
    write_weights(path, weights=weights, **ABOUT)
    assert torch.load(path, weights_only=True)["format"] == 1
    held = read_weights(path)
    assert {name: held[name] for name in ABOUT} == ABOUT
    other = small_model(seed=2)
    fit_weights(other, held["weights"], path)
    assert all(torch.equal(value, weights[name]) for name, value in other.state_dict().items())


def test_weights_that_are_too_many_for_float32_are_halved_and_twice_as_many_refused():
    room = LARGEST // 4
    assert compact({"a": torch.zeros(room // 2)})["a"].dtype == torch.float32
    halved = compact({"a": torch.zeros(room * 3 // 2), "steps": torch.zeros(1, dtype=torch.int64)})
    assert [value.dtype for value in halved.values()] == [torch.bfloat16, torch.int64]
    with pytest.raises(ValueError, match=r"7\.5 M weights do not fit into 10 MB"):
        compact({"a": torch.zeros(room * 3)})


def test_bfloat16_weights_are_loaded_into_a_float32_model(tmp_path):
    weights = {
        name: value.bfloat16() if value.is_floating_point() else value
        for name, value in small_model().state_dict().items()
    }
    model = small_model(seed=2)
    fit_weights(model, weights, tmp_path)
    assert {parameter.dtype for parameter in model.parameters()} == {torch.float32}


def test_another_model_is_one_line_that_names_the_first_tensor(tmp_path):
    weights = small_model().state_dict()
    with pytest.raises(
        ValueError, match=r"x\.pt is of another model: \d+ tensors differ, the first is '.*', which is not there"
    ):
        fit_weights(small_model(names=("lidar",), fuser="average"), weights, tmp_path / "x.pt")
    name = next(iter(weights))
    weights[name] = torch.zeros(3)
    with pytest.raises(ValueError, match=r"1 tensors differ, the first is '.*', which is \[3\] there and \[") as caught:
        fit_weights(small_model(), weights, tmp_path / "x.pt")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"not a pickle", None])
def test_a_file_that_holds_no_weights_is_named(tmp_path, content):
    path = tmp_path / "x.pt"
    torch.save({"weights": {}}, path) if content is None else path.write_bytes(content)
    with pytest.raises(ValueError, match=r"x\.pt is no (readable )?file of weights"):
        read_weights(path)
