import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.boxes import Boxes
from fusion_net.data.targets import center_targets, gaussian_radius

GRID = BEVGrid(-10.0, 30.0, -8.0, 16.0, 0.5)  # 48 rows, 80 columns, off-centre


def boxes(*rows, wlh=(2.0, 4.5, 1.6)):
    """Rows of x, y, label and optionally yaw, vx, vy."""
    table = np.array([(*row, *(0.3, 1.0, -2.0)[len(row) - 3 :]) for row in rows], float).reshape(-1, 6)
    center = np.column_stack([table[:, :2], np.full(len(table), 0.9)])
    return Boxes.labels(center, np.tile(wlh, (len(table), 1)), table[:, 3], table[:, 4:], table[:, 2].astype(int))


def targets(*samples, grid=GRID, **options):
    return center_targets(samples, grid=grid, num_classes=3, **options)


def test_the_lessons_cell():
    square = BEVGrid(-50.0, 50.0, -50.0, 50.0, 0.5)
    made = targets(boxes((12.0, -3.0, 1)), grid=square)
    assert made.heatmap[0, 1, 94, 124] == 1
    assert made.mask[0].nonzero().tolist() == [[94, 124]]
    np.testing.assert_allclose(made.offset[0, :, 94, 124], (-0.25, -0.25))  # from the cell's centre (12.25, -2.75)


def test_everything_of_a_box_is_at_its_cell():
    made = targets(boxes((5.1, -2.6, 2, 2.5, 3.0, -4.0)))
    row, column = made.mask[0].nonzero()[0].tolist()
    assert (row, column) == (10, 30)
    for name, expected in {
        "offset": (5.1 - 5.25, -2.6 + 2.75),
        "height": (0.9,),
        "size": np.log((2.0, 4.5, 1.6)),
        "rot": (np.sin(2.5), np.cos(2.5)),
        "velocity": (3.0, -4.0),
    }.items():
        np.testing.assert_allclose(getattr(made, name)[0, :, row, column], expected, atol=1e-6)


@settings(max_examples=60)
@given(
    x=st.floats(-30, 60), y=st.floats(-30, 40), cell=st.sampled_from([0.25, 0.4, 0.5, 1.0, 2.0]),
    x_min=st.sampled_from([-20.0, 0.0, 4.0]), y_min=st.sampled_from([-12.0, 2.0]),
)  # fmt: skip
def test_cell_and_offset_give_the_centre_back_or_the_box_is_off_the_grid(x, y, cell, x_min, y_min):
    grid = BEVGrid(x_min, x_min + 40, y_min, y_min + 24, cell)
    made = targets(boxes((x, y, 0)), grid=grid)
    inside = x_min <= x < x_min + 40 and y_min <= y < y_min + 24
    cells = made.mask[0].nonzero()
    if not inside and len(cells):  # on the very edge float rounding may decide either way
        assert min(abs(x - x_min), abs(x - x_min - 40), abs(y - y_min), abs(y - y_min - 24)) < 1e-6
    if not len(cells):
        assert not made.heatmap.any()
        return
    row, column = cells[0].tolist()
    center = grid.centers()[row, column] + made.offset[0, :, row, column]
    np.testing.assert_allclose(center, (x, y), atol=1e-4)
    assert (made.offset[0, :, row, column].abs() <= cell / 2 + 1e-5).all()
    assert made.heatmap[0, 0, row, column] == made.heatmap.max() == 1


def test_a_box_just_below_the_grid_is_not_folded_into_its_first_cell():
    assert not targets(boxes((-10.2, 0.0, 0), (5.0, -8.3, 0))).mask.any()


def test_overlapping_gaussians_keep_the_larger_value_and_never_lower_a_peak():
    one, other = boxes((5.2, 2.2, 0)), boxes((6.2, 2.2, 0))
    both = targets(boxes((5.2, 2.2, 0), (6.2, 2.2, 0)), min_radius=4)
    apart = [targets(b, min_radius=4).heatmap for b in (one, other)]
    np.testing.assert_array_equal(both.heatmap, torch.maximum(*apart))
    assert (both.heatmap == 1).sum() == 2


def test_the_gaussian_is_cut_at_its_radius_and_at_the_grids_edge():
    heatmap = targets(boxes((-9.9, -7.9, 0)), min_radius=3).heatmap[0, 0]
    assert heatmap[0, 0] == 1
    assert heatmap.nonzero().max() == 3
    assert (heatmap > 0).sum() == 16
    assert heatmap[0, 3] == pytest.approx(np.exp(-9 / (2 * (7 / 6) ** 2)))


def test_of_two_objects_in_a_cell_the_nearer_is_regressed_and_both_peak():
    near, far = (5.05, 2.05, 0, 0.1), (5.4, 2.4, 1, 0.2)
    for order in ((near, far), (far, near)):
        made = targets(boxes(*order))
        assert made.mask.sum() == 1
        assert made.rot[made.mask.unsqueeze(1).expand_as(made.rot)][0] == pytest.approx(np.sin(0.1))
        assert (made.heatmap == 1).sum() == 2


def test_unknown_velocity_stays_unknown():
    made = targets(boxes((5.0, 2.0, 0, 0.0, np.nan, np.nan)))
    assert made.velocity.isnan().sum() == 2
    assert not made.heatmap.isnan().any()


def test_a_batch_is_its_samples_and_an_empty_one_is_zero():
    samples = [boxes((5.0, 2.0, 0), (9.0, -3.0, 2)), Boxes.empty(), boxes((5.0, 2.0, 1))]
    together = targets(*samples)
    for index, sample in enumerate(samples):
        alone = targets(sample)
        for name in ("heatmap", "mask", "offset", "height", "size", "rot", "velocity"):
            np.testing.assert_array_equal(getattr(together, name)[index], getattr(alone, name)[0])
    assert not targets(Boxes.empty()).heatmap.any()
    assert targets(Boxes.empty()).heatmap.shape == (1, 3, 48, 80)


@settings(max_examples=60)
@given(length=st.floats(0.3, 40), width=st.floats(0.3, 20), overlap=st.floats(0.05, 0.9))
def test_corners_moved_by_the_radius_leave_the_overlap(length, width, overlap):
    radius = gaussian_radius(np.array([length]), np.array([width]), overlap)[0]

    def iou(
        low, high
    ):  # of [0, size] with the box whose lower corner moved by low and upper corner by high, on both axes
        inner = np.prod([max(min(size, size + high) - max(0, low), 0) for size in (length, width)])
        moved = np.prod([max(size + high - low, 0) for size in (length, width)])
        return inner / (length * width + moved - inner)

    cases = [iou(radius, radius), iou(radius, -radius), iou(-radius, radius)]
    assert min(cases) == pytest.approx(overlap, abs=1e-6)


def test_heatmap_radius_grows_with_the_object():
    small, large = (targets(boxes((5.2, 2.2, 0), wlh=wlh)).heatmap for wlh in ((2.0, 4.5, 1.5), (6.0, 16.0, 3.0)))
    assert (small > 0).sum() == 25  # the least radius, 2 cells
    assert (large > 0).sum() > 100
