"""A grid whose cells grow with the distance: the map and its inverse, and what every grid promises."""

import numpy as np
import pytest
import torch
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from fusion_net.common.bev_grid import BEVGrid, GradedGrid
from fusion_net.common.drawing import BEVPanel

GRADED = GradedGrid(-4.0, 40.0, -12.0, 20.0, 0.4, 48, 60)  # neither square nor centred
NANO = BEVGrid(0.0, 51.2, -22.4, 22.4, 0.8)


@st.composite
def grids(draw) -> GradedGrid:
    """Any ground, the car on it or not, with anything from a few large cells to as many as fit."""
    x_min, y_min = (draw(st.sampled_from([-30.0, -6.4, 0.0, 5.0])) for _ in range(2))
    width, height = (draw(st.floats(4.0, 100.0)) for _ in range(2))
    cell = draw(st.floats(0.05, 2.0))
    most = int(height / cell), int(width / cell)
    assume(min(most) >= 1)
    rows, columns = (draw(st.integers(max(1, n // 8), min(n, 400))) for n in most)
    return GradedGrid(x_min, x_min + width, y_min, y_min + height, cell, rows, columns)


def axes(grid):
    """Both axes with their bounds in metres."""
    return (grid.x_axis, grid.x_min, grid.x_max), (grid.y_axis, grid.y_min, grid.y_max)


def numbers(count):
    return torch.arange(count, dtype=torch.float64)


@settings(max_examples=60)
@given(grid=grids(), share=st.floats(-0.3, 1.3))
def test_metres_to_cells_and_back(grid, share):
    for axis, low, high in axes(grid):
        for dtype, error in ((torch.float64, 1e-9), (torch.float32, 1e-4)):
            x = torch.tensor(low + share * (high - low), dtype=dtype)
            assert axis.to_metres(axis.to_cells(x)).item() == pytest.approx(x.item(), abs=error)
            assert axis.to_cells(x).dtype == dtype


@settings(max_examples=40)
@given(grid=grids())
def test_cells_cover_the_ground_from_bound_to_bound_and_grow_with_the_distance(grid):
    assert grid.shape == (grid.rows, grid.columns)
    for axis, low, high in axes(grid):
        edges = axis.to_metres(numbers(axis.count + 1))
        assert edges[[0, -1]].tolist() == pytest.approx([low, high], abs=1e-6)
        sizes = edges.diff()
        torch.testing.assert_close(torch.as_tensor(axis.size(numbers(axis.count))).expand(axis.count), sizes)
        assert (sizes >= grid.cell * (1 - 1e-6)).all()  # and thus no gap and no overlap
        away = torch.stack([edges[:-1], edges[1:]]).abs().amin(dim=0)
        clear = (edges[:-1] >= 0) | (edges[1:] <= 0)  # the cell with the car in it begins on either side
        order = away[clear].argsort()
        assert (sizes[clear][order].diff() > -1e-6).all()


@settings(max_examples=60)
@given(grid=grids())
def test_a_centre_falls_into_its_own_cell(grid):
    row, column, inside = grid.rows_columns(grid.centers())
    rows, columns = grid.shape
    assert inside.all()
    assert torch.equal(row, torch.arange(rows)[:, None].expand(rows, columns))
    assert torch.equal(column, torch.arange(columns).expand(rows, columns))


@settings(max_examples=60)
@given(grid=grids(), x=st.floats(-40, 120), y=st.floats(-40, 120))
def test_a_place_is_between_the_edges_of_its_cell_or_off_the_ground(grid, x, y):
    row, column, inside = grid.rows_columns(torch.tensor([x, y], dtype=torch.float64))
    gap = min(abs(x - grid.x_min), abs(x - grid.x_max), abs(y - grid.y_min), abs(y - grid.y_max))
    assert bool(inside) == bool(grid.contains(np.array([[x, y]]))[0]) or gap < 1e-6
    for axis, index, place in ((grid.x_axis, column, x), (grid.y_axis, row, y)):
        low, high = axis.to_metres(torch.stack([index, index + 1]).double()).tolist()
        assert not inside or low - 1e-6 <= place <= high + 1e-6


def test_what_is_left_of_the_car_mirrors_what_is_right_of_it():
    grid = GradedGrid(0.0, 51.2, -22.4, 22.4, 0.4, 55, 64)
    xy = torch.rand(1000, 2, generator=torch.Generator().manual_seed(0)) * torch.tensor([51.0, 22.0])
    mirrored = xy * torch.tensor([1.0, -1.0])
    (row, column, _), (other_row, other_column, _) = grid.rows_columns(xy), grid.rows_columns(mirrored)
    assert torch.equal(other_row, 54 - row)
    assert torch.equal(other_column, column)
    torch.testing.assert_close(grid.centers().flip(0) * torch.tensor([1.0, -1.0]), grid.centers(), rtol=0, atol=1e-5)


def test_as_many_cells_as_fit_are_the_uniform_grid_to_the_bit():
    same = GradedGrid(0.0, 51.2, -22.4, 22.4, 0.8, 56, 64)
    xy = torch.rand(5000, 2) * 80 - 20
    cells, others = torch.randint(40, (2, 100)), torch.randint(40, (2, 100))
    for grid, expected in ((same, NANO), (same.refined(2), NANO.refined(2))):
        assert grid.shape == expected.shape
        assert torch.equal(grid.centers(), expected.centers())
        assert all(map(torch.equal, grid.rows_columns(xy), expected.rows_columns(xy)))
        assert torch.equal(grid.between(tuple(cells), tuple(others)), expected.between(tuple(cells), tuple(others)))
        assert grid.sides() == expected.sides() == (expected.cell, expected.cell)


def test_the_metres_between_cells_are_those_between_their_centres():
    centers, cells, others = GRADED.centers(), torch.randint(48, (2, 100)), torch.randint(48, (2, 100))
    metres = GRADED.between(tuple(cells), tuple(others))
    torch.testing.assert_close(metres, centers[tuple(others)] - centers[tuple(cells)], rtol=0, atol=1e-5)


@pytest.mark.parametrize("grid", [GRADED, NANO])
@pytest.mark.parametrize("factor", [2, 4])
def test_a_refined_grid_cuts_every_cell(grid, factor):
    fine = grid.refined(factor)
    assert fine.shape == tuple(factor * n for n in grid.shape)
    row, column, _ = fine.rows_columns(fine.centers())
    coarse_row, coarse_column, _ = grid.rows_columns(fine.centers())
    assert torch.equal(coarse_row, row // factor)
    assert torch.equal(coarse_column, column // factor)
    torch.testing.assert_close(fine.x_axis.to_metres(factor * numbers(30)), grid.x_axis.to_metres(numbers(30)))


def test_a_picture_of_a_map_shows_every_place_its_own_cell():
    """Under the pixel at which a point is drawn lies the value of the point's cell."""
    panel = BEVPanel(GRADED, scale=20.0)
    number = np.arange(48 * 60).reshape(48, 60)
    picture = panel.of_map(number)
    assert picture.shape == panel.canvas().shape[:2]
    xy = np.random.default_rng(0).uniform([-4, -12], [40, 20], (500, 2))
    u, v = np.floor(panel.pixels(xy)).astype(int).T
    middle = np.stack([GRADED.x_max - (v + 0.5) / 20, GRADED.y_max - (u + 0.5) / 20], axis=1)  # of the pixel
    row, column, _ = GRADED.rows_columns(torch.from_numpy(middle))
    np.testing.assert_array_equal(picture[v, u], number[row, column])
    assert set(np.unique(picture)) == set(number.ravel())  # no cell is too small to be seen at this scale


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rows": 57}, r"rows=57 cells of at least 0\.8 m do not fit into y from -22\.4 to 22\.4 m; take rows=56"),
        ({"columns": 65}, r"columns=65 .* take columns=64 or fewer, or cell=0\.787692 or less"),
        ({"rows": 0}, "rows=0 must be at least 1"),
        ({"x_max": -1.0}, r"x_max=-1\.0 must be above x_min=0\.0"),
        ({"cell": 0.0}, r"cell=0\.0 must be above 0"),
        ({"y_max": float("inf")}, "bounds finite"),
    ],
)  # fmt: skip
def test_numbers_that_make_no_grid_are_named(change, message):
    numbers = {"x_min": 0.0, "x_max": 51.2, "y_min": -22.4, "y_max": 22.4, "cell": 0.8, "rows": 56, "columns": 64}
    with pytest.raises(ValueError, match=message):
        GradedGrid(**numbers | change)
