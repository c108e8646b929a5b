import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from fusion_net.common.bev_grid import BEVGrid

GRID = BEVGrid(x_min=-4.0, x_max=20.0, y_min=-9.0, y_max=3.0, cell=0.5)


def test_shape_is_rows_then_columns():
    assert GRID.shape == (24, 48)
    assert GRID.refined(2).shape == (48, 96)


def test_just_below_the_lower_bound_is_outside_not_cell_zero():
    xy = torch.tensor([[-4.3, 0.0], [0.0, -9.3], [-3.9, -8.9], [20.0, 0.0], [0.0, 3.0]])
    assert GRID.rows_columns(xy)[2].tolist() == [False, False, True, False, False]


def test_the_lower_bound_belongs_to_the_grid_and_the_upper_does_not():
    xy = torch.tensor([[-4.0, 0.0], [0.0, -9.0], [20.0, 0.0], [0.0, 3.0]])
    assert GRID.rows_columns(xy)[2].tolist() == GRID.contains(xy.numpy()).tolist() == [True, True, False, False]


def test_nan_is_outside():
    row, column, inside = GRID.rows_columns(torch.tensor([float("nan"), 0.0]))
    assert not inside
    assert row >= 0
    assert column >= 0


def test_centres_lie_half_a_cell_from_the_bounds():
    assert GRID.centers()[0, 0].tolist() == [-3.75, -8.75]
    assert GRID.centers()[-1, -1].tolist() == [19.75, 2.75]


def test_centres_fall_into_their_own_cells():
    row, column, inside = GRID.rows_columns(GRID.centers())
    assert inside.all()
    assert torch.equal(row, torch.arange(24)[:, None].expand(24, 48))
    assert torch.equal(column, torch.arange(48).expand(24, 48))


@given(st.floats(-30, 30), st.floats(-30, 30))
def test_numpy_and_torch_agree_on_what_is_inside(x, y):
    point = torch.tensor([x, y], dtype=torch.float64)
    assert bool(GRID.contains(point[None].numpy())[0]) == bool(GRID.rows_columns(point)[2])


def test_a_ragged_grid_names_the_nearest_bound():
    with pytest.raises(ValueError, match=r"nearest x_max is 10\.4"):
        BEVGrid(x_min=0.0, x_max=10.5, y_min=0.0, y_max=8.0, cell=0.8)
