"""Claims that are arithmetic: worked out with the project's own functions, each time the page is written.

The lesson's y axis points right where ours points left: its numbers are fed, not its words.
"""

import numpy as np
import torch
from torch.utils.flop_counter import FlopCounterMode

from fusion_net.common import geometry
from fusion_net.common.bev_grid import BEVGrid
from fusion_net.models.bev_decoder import BEVDecoder
from fusion_net.models.blocks.depth_bins import DepthBins
from fusion_net.models.encoders.lift_splat import LiftSplat
from fusion_net.reports.claims.claim import Claim, verdict

TEST = "python -m pytest tests/fusion_net/test_lesson.py"
CAM_K = np.array([[1000.0, 0, 960], [0, 1000, 540], [0, 0, 1]])
AXES = [[0, 1, 0], [0, 0, -1], [1, 0, 0]]
"""From the lesson's x forward, y right, z up to the camera's x right, y down, z forward."""
GRID = BEVGrid(-50.0, 50.0, -50.0, 50.0, 0.5)


def claims() -> list[Claim]:
    """All of them."""
    return [
        scale_ambiguity(), painted_pixel(), half_a_degree(), fifty_milliseconds(), cell(), conservation(), splat_sum(),
        sharp_and_flat(), cost_of_the_grid(),
    ]  # fmt: skip


def _pixels(points: np.ndarray) -> np.ndarray:
    return geometry.project(CAM_K, points)[0]


def scale_ambiguity() -> Claim:
    """Near and small, far and large."""
    heights = [
        float(np.ptp(_pixels(np.array([[0, 0, z], [0, -tall, z]]))[:, 1])) for tall, z in ((1.5, 30.0), (3.0, 60.0))
    ]
    return Claim(
        "A person of 1.5 m at 30 m and a sign of 3.0 m at 60 m are both 50 pixels high (f = 1000): an image has no scale",
        TEST,
        f"{heights[0]:.0f} and {heights[1]:.0f} pixels",
        verdict(np.allclose(heights, 50)),
        "The generated scenes have people at twice the size at twice the distance.",
    )


def painted_pixel() -> Claim:
    """The lesson's worked projection."""
    cam_T_lidar = geometry.rigid(AXES, [-0.2, 0, 0])
    u, v = np.floor(_pixels(geometry.transform(cam_T_lidar, [[8.0, 1.0, 0.5]]))[0]).astype(int)
    return Claim(
        "The LiDAR point (8, 1, 0.5) lands on pixel (1060, 477) of a camera 0.2 m aside",
        TEST,
        f"({u}, {v})",
        verdict((u, v) == (1060, 477)),
        'The text says "1 m to the left" and computes 1 m to the right.',
    )


def half_a_degree() -> Claim:
    """What a turned mount does to the painted pixel."""
    turned = geometry.rigid(AXES, np.zeros(3)) @ geometry.from_yaw(np.radians(0.5))
    shifts = [float(_pixels(geometry.transform(turned, [[z, 0.0, 0.0]]))[0, 0] - 960) for z in (8.0, 30.0, 80.0)]
    metres = 8 * np.tan(np.radians(0.5))
    return Claim(
        "Half a degree of calibration error is 0.07 m at 8 m and moves the painted pixel by 8.7 pixels (f = 1000)",
        TEST,
        f"{metres:.2f} m; {shifts[0]:.1f} pixels at 8 m, {shifts[1]:.1f} at 30 m, {shifts[2]:.1f} at 80 m",
        verdict(round(metres, 2) == 0.07, round(shifts[0], 1) == 8.7),
        "As many pixels at any distance: what grows is the error in metres.",
    )


def fifty_milliseconds() -> Claim:
    """The lesson's clock error."""
    return Claim(
        "Sensors 50 ms apart are 1 m apart on a car that closes at 20 m/s",
        TEST,
        f"{20 * 0.05:.1f} m; the test drives an ego path at 20 m/s",
        verdict(bool(np.isclose(20 * 0.05, 1.0))),
    )


def cell() -> Claim:
    """The lesson's worked cell."""
    row, column, _ = GRID.rows_columns(torch.tensor([[12.0, -3.0]]))
    found = (int(row), int(column))
    return Claim(
        "A point 12 m ahead and 3 m aside falls into cell (94, 124) of 200 x 200 cells of 0.5 m",
        TEST,
        f"{found} of {GRID.shape[0]} x {GRID.shape[1]}",
        verdict(found == (94, 124), GRID.shape == (200, 200)),
        "The lesson rounds and this grid takes the floor: the same for its numbers, half a cell apart for most others.",
    )


def _lift(weights: list[list[float]], bins: DepthBins, features: list[list[float]], x: list[float]) -> torch.Tensor:
    """Map (C, Y, X) of one-pixel cameras at (``x``, -2.75), each looking ahead with a feature and depth weights."""
    lift = LiftSplat(grid=GRID, bins=bins, stride=1)
    n = len(x)
    cam_K = torch.tensor([[1.0, 0, 0.5], [0, 1, 0.5], [0, 0, 1]]).expand(1, n, 3, 3)
    poses = [geometry.rigid([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], [each, -2.75, 1.5]) for each in x]
    ego_T_cam = torch.tensor(np.array(poses)).float()[None]
    columns = torch.tensor(features).view(1, n, 1, 1, 1, -1)
    return lift(columns, torch.tensor(weights).view(1, n, 1, 1, -1), cam_K, ego_T_cam)[0]


METRES = DepthBins(7.5, 10.5, 3, "linear")


def conservation() -> Claim:
    """The lesson's worked lift."""
    bev = _lift([[0.2, 0.5, 0.3]], METRES, [[4.0, 10.0]], [12.25 - 9.0])
    blocks = bev[:, 94, [122, 124, 126]].T
    total = bev.sum((1, 2))
    return Claim(
        "The lift spreads c = [4, 10] by [0.2, 0.5, 0.3] into [0.8, 2.0], [2.0, 5.0], [1.2, 3.0]; nothing is lost",
        TEST,
        f"{_numbers(blocks)}; sum {_numbers(total[None])}",
        verdict(
            torch.allclose(blocks, torch.tensor([[0.8, 2.0], [2.0, 5.0], [1.2, 3.0]])),
            torch.allclose(total, torch.tensor([4.0, 10.0])),
        ),
        "On the grid; what is lifted beyond its edge is gone.",
    )


def splat_sum() -> Claim:
    """Two rays that meet."""
    bev = _lift([[0.2, 0.5, 0.3], [1.0, 0.0, 0.0]], METRES, [[4.0, 10.0], [1.0, 0.5]], [12.25 - 9.0, 12.25 - 8.0])
    met = bev[:, 94, 124]
    return Claim(
        "Where the 9 m block meets [1.0, 0.5] of another ray, the cell holds [3.0, 5.5]",
        TEST,
        _numbers(met[None]),
        verdict(torch.allclose(met, torch.tensor([3.0, 5.5]))),
    )


def _numbers(rows: torch.Tensor) -> str:
    return ", ".join(f"[{', '.join(f'{value:.1f}' for value in row)}]" for row in rows.tolist())


def sharp_and_flat() -> Claim:
    """How many cells a feature is spread over."""
    bins = DepthBins(4.0, 45.0, 41, "linear")
    sharp = [0.0] * 41
    sharp[11] = 1.0
    cells, highest = [], []
    for weights in (sharp, [1 / 41] * 41):
        bev = _lift([weights], bins, [[1.0]], [0.0])
        cells.append(int((bev > 0).sum()))
        highest.append(float(bev.max()))
    return Claim(
        "A sharp depth distribution puts the feature into one cell, a flat one smears it over many",
        "python eval.py run=runs/demo audits=depth",
        f"41 bins from 4 to 45 m: sharp {cells[0]} cell with all of it, flat {cells[1]} cells with at most {highest[1]:.3f}"
        " each",
        verdict(cells[0] == 1, cells[1] > 30),
    )


def cost_of_the_grid() -> Claim:
    """Multiplications of the decoder that works on the map."""
    flops = []
    for size in (200, 400):
        with torch.device("meta"):
            decoder, bev = BEVDecoder(channels=32, half=96, quarter=96).eval(), torch.zeros(1, 32, size, size)
            with FlopCounterMode(display=False) as counter:
                decoder(bev)
        flops.append(counter.get_total_flops())
    ratio = flops[1] / flops[0]
    return Claim(
        "400 x 400 cells instead of 200 x 200 (half the cell, or twice the range) are 4 times the compute",
        "python -m fusion_net.reports.claims",
        f"40,000 and 160,000 cells; operations of the decoder {ratio:.2f} times",
        verdict(abs(ratio - 4) < 0.05),
        "Of what works on the map. Encoders of images and points do not grow with it.",
    )
