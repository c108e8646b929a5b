"""What the head is trained on, rendered on the bird's-eye grid (CenterPoint, arXiv 2006.11275, section 4).

Every object puts a Gaussian of peak 1 at its cell on the heat map of its class; where they overlap the larger value
stays. The box itself is written at that one cell.
"""

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.boxes import Boxes
from fusion_net.data.batch import Targets


def gaussian_radius(length: NDArray, width: NDArray, min_overlap: float) -> NDArray[np.float64]:
    """How far both corners of a box may move and leave an IoU of ``min_overlap`` with it: the smallest root of three
    cases, both corners along with each other, both inwards, both outwards (CornerNet, arXiv 1808.01244).

    The widely copied code divides every root by 2 where the quadratic formula has 2a; this is the formula.
    """
    total, area, o = length + width, length * width, min_overlap
    along = (total - np.sqrt(total**2 - 4 * area * (1 - o) / (1 + o))) / 2
    inwards = (total - np.sqrt(total**2 - 4 * area * (1 - o))) / 4
    outwards = (-o * total + np.sqrt((o * total) ** 2 + 4 * o * (1 - o) * area)) / (4 * o)
    return np.minimum(np.minimum(along, inwards), outwards)


def center_targets(
    boxes: Sequence[Boxes], *, grid: BEVGrid, num_classes: int, min_overlap: float = 0.1, min_radius: int = 2
) -> Targets:
    """Targets of a batch from the boxes of each sample in the ego frame; objects off the grid are left out.

    A Gaussian is round in metres: where cells are longer than wide its radii in cells differ. ``min_radius`` in cells. Of two
    objects in one cell the nearer to the ego keeps it.
    """
    sample = np.repeat(np.arange(len(boxes)), [len(b) for b in boxes])
    center, wlh, yaw, velocity, label = (
        np.concatenate([getattr(b, name) for b in (Boxes.empty(), *boxes)])
        for name in ("center", "wlh", "yaw", "velocity", "label")
    )
    row, column, inside = (t.numpy() for t in grid.rows_columns(torch.from_numpy(center[:, :2])))
    near_first = np.argsort(np.hypot(center[:, 0], center[:, 1]), kind="stable")
    chosen = near_first[inside[near_first]]
    sample, row, column, label = sample[chosen], row[chosen], column[chosen], label[chosen]
    center, wlh, yaw, velocity = center[chosen], wlh[chosen], yaw[chosen], velocity[chosen]

    rows, columns = grid.shape
    radii = []
    for axis, index in ((grid.y_axis, row), (grid.x_axis, column)):
        size = np.asarray(axis.size(torch.from_numpy(index)))
        radius = gaussian_radius(wlh[:, 1] / size, wlh[:, 0] / size, min_overlap).astype(np.int64)
        radii.append(np.maximum(radius, min_radius))
    heatmap = _render_heatmap((len(boxes), num_classes, rows, columns), sample, label, (row, column), radii)
    _, first = np.unique((sample * rows + row) * columns + column, return_index=True)
    cell = (sample[first], row[first], column[first])
    cell_center = grid.centers().numpy()[cell[1], cell[2]]
    values = {
        "offset": center[first, :2] - cell_center,
        "height": center[first, 2:],
        "size": np.log(wlh[first]),
        "rot": np.stack([np.sin(yaw), np.cos(yaw)], axis=1)[first],
        "velocity": velocity[first],
    }
    maps = {name: np.zeros((len(boxes), value.shape[1], rows, columns), np.float32) for name, value in values.items()}
    for name, value in values.items():
        maps[name][cell[0], :, cell[1], cell[2]] = value
    mask = np.zeros((len(boxes), rows, columns), bool)
    mask[cell] = True
    return Targets(
        heatmap=torch.from_numpy(heatmap),
        mask=torch.from_numpy(mask),
        **{name: torch.from_numpy(value) for name, value in maps.items()},
    )


def _render_heatmap(shape, sample, label, cell, radii) -> NDArray[np.float32]:
    """Heat maps (B, K, Y, X): the footprints of all Gaussians scattered at once, by maximum. ``cell`` and ``radii``: rows and
    columns."""
    _, classes, rows, columns = shape
    reach = [np.arange(-radius.max(initial=0), radius.max(initial=0) + 1) for radius in radii]
    dy, dx = (axis.ravel() for axis in np.meshgrid(*reach, indexing="ij"))
    (row, column), (tall, wide) = (tuple(value[:, None] for value in pair) for pair in (cell, radii))
    sigma_y, sigma_x = (2 * tall + 1) / 6, (2 * wide + 1) / 6
    value = np.exp(-(dx**2 + (dy * (sigma_x / sigma_y)) ** 2) / (2 * sigma_x**2))
    y, x = row + dy, column + dx
    inside = (abs(dy) <= tall) & (abs(dx) <= wide) & (y >= 0) & (y < rows) & (x >= 0) & (x < columns)
    cell = ((sample * classes + label)[:, None] * rows + y) * columns + x
    heatmap = np.zeros(shape, np.float32)
    np.maximum.at(heatmap.reshape(-1), cell[inside], value[inside].astype(np.float32))
    return heatmap
