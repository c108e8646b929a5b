"""The picture of a rig's coverage: from above every sensor's place, field of view and range; close up what of the ground is
covered; from the side the LiDARs' beams and the cameras' vertical fields of view."""

from pathlib import Path
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from matplotlib import pyplot
from matplotlib.colors import ListedColormap
from matplotlib.patches import Patch, Polygon, Rectangle, Wedge
from numpy.typing import NDArray

from data_gen.rig.mounts import Mount
from data_gen.rig.rig import Rig
from data_gen.road.ego import EGO_OUTLINE
from fusion_net.common import modalities

matplotlib.use("Agg")


class Style(NamedTuple):
    """How the sensors of a modality are drawn."""

    color: str
    opacity: float  # of the field of view from above
    line: str  # of its edge
    name_at: float | None  # fraction of the range at which the channel is named; None: not
    name_aside: float  # fraction of the range by which the name is moved outwards: rear radars look alike
    is_field: bool  # from the side: all between the lowest and the highest elevation, or single beams


STYLES = {
    "camera": Style(modalities.STYLES["camera"].color, 0.22, "-", 0.72, 0.0, is_field=True),
    "lidar": Style(modalities.STYLES["lidar"].color, 0.08, ":", None, 0.0, is_field=False),
    "radar": Style(modalities.STYLES["radar"].color, 0.07, ":", 0.9, 0.15, is_field=True),
}
CAMERA_REACH = 60.0
"""Metres that a camera's wedge is drawn to."""
NEAR, CELL = 12.0, 0.05
"""Reach and cell of the close-up, metres."""
GROUND = {
    "no camera, no LiDAR": "#3b3b3b", "camera only": "#a6cbe8", "LiDAR only": "#b5dfb0", "camera and LiDAR": "#ffffff",
}  # fmt: skip


def draw(rig: Rig, out: Path) -> None:
    """Writes the picture."""
    figure = pyplot.figure(figsize=(13, 8.2), layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=(1.25, 1), height_ratios=(1.75, 1))
    _far(figure.add_subplot(grid[0, 0]), rig)
    _near(figure.add_subplot(grid[0, 1]), rig)
    _side(figure.add_subplot(grid[1, :]), rig)
    figure.suptitle(f"rig {rig.name}: cameras {len(rig.cameras)}, LiDARs {len(rig.lidars)}, radars {len(rig.radars)}")
    figure.savefig(out, dpi=90)
    pyplot.close(figure)


def _far(axes: Any, rig: Rig) -> None:
    """Fields of view to their ranges; ahead is up, left is left."""
    reach = 1.0
    for channel, mount in rig.sensors.items():
        low, high = mount.azimuth_range_deg
        yaw, radius = mount.rotation_deg[2], mount.max_range if np.isfinite(mount.max_range) else CAMERA_REACH
        x, y, _ = mount.translation
        style = STYLES[mount.modality]
        span = {"theta1": 90 + yaw + low, "theta2": 90 + yaw + high}
        axes.add_patch(Wedge((-y, x), radius, **span, color=style.color, alpha=style.opacity, lw=0))
        axes.add_patch(Wedge((-y, x), radius, **span, fill=False, ec=style.color, lw=0.9, ls=style.line))
        reach = max(reach, radius)
        if style.name_at is not None:
            turn, at = np.radians(90 + yaw + (low + high) / 2), style.name_at * radius
            aside = style.name_aside * radius * np.sign(round(y, 1))
            place = (-y + at * np.cos(turn) - aside, x + at * np.sin(turn))
            name = channel.partition("_")[2].replace("_", "\n")
            axes.annotate(name, place, ha="center", va="center", fontsize=7, color=style.color)
    _car(axes)
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
    axes.set(xlabel="left  <  metres  >  right", ylabel="metres ahead")
    axes.set_title(f"fields of view: cameras (blue) to {CAMERA_REACH:.0f} m, LiDARs green, radars orange", fontsize=10)


def _near(axes: Any, rig: Rig) -> None:
    """What of the ground around the car is covered, and where the sensors sit."""
    steps = np.arange(-NEAR + CELL / 2, NEAR, CELL)
    x, y = np.meshgrid(steps + np.mean(EGO_OUTLINE[0]), steps, indexing="ij")  # rows run ahead
    points = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    by_camera, by_lidar = (
        np.any([np.zeros(len(points), bool), *(mount.sees(points) for mount in mounts)], axis=0)
        for mounts in (rig.cameras.values(), rig.lidars.values())
    )
    level = (by_camera + 2 * by_lidar).reshape(x.shape)[:, ::-1]  # left on the left
    extent = (steps[0], steps[-1], x[0, 0], x[-1, 0])
    shown = ListedColormap(list(GROUND.values()))(level / 3.0)
    axes.imshow(shown, origin="lower", extent=extent, interpolation="nearest")
    for mount in rig.sensors.values():
        (x0, y0, _), ahead = mount.translation, mount.ego_T_body[:2, 0]
        color = STYLES[mount.modality].color
        tip = (-y0 - 1.1 * ahead[1], x0 + 1.1 * ahead[0])
        axes.annotate("", tip, (-y0, x0), arrowprops={"arrowstyle": "->", "color": color})
        axes.plot(-y0, x0, "o", color=color, ms=5, mec="white", mew=0.6)
    _car(axes)
    handles = [Patch(fc=color, ec="grey", label=label) for label, color in GROUND.items()]
    axes.legend(handles=handles, fontsize=7, loc="lower right", framealpha=0.9)
    axes.set(xlabel="left  <  metres  >  right")
    axes.set_title("ground covered around the car", fontsize=10)


def _side(axes: Any, rig: Rig) -> None:
    """Beams and vertical fields over the ground, of the sensors that look ahead (to the right) or back."""
    far = np.array([0.0, 30.0])
    for mount in rig.sensors.values():
        x, _, z = mount.translation
        style = STYLES[mount.modality]
        line = {"lw": 1.1} if style.is_field else {"lw": 0.5, "alpha": 0.45}
        for ahead, slopes in _slopes(mount):
            for slope in slopes:
                end = min(far[1], z / -slope) if slope < -1e-3 else far[1]
                axes.plot([x, x + ahead * end], [z, z + end * slope], color=style.color, **line)
            if style.is_field:
                span = (z + far * slopes[0], z + far * slopes[-1])
                axes.fill_between(x + ahead * far, *span, color=style.color, alpha=0.10, lw=0)
        axes.plot(x, z, "o", color=style.color, ms=4, mec="white", mew=0.6, zorder=5)
    (back, front), _ = EGO_OUTLINE
    axes.add_patch(Rectangle((back, 0.25), front - back, 0.7, fc="#dddddd", ec="black", lw=0.8))
    axes.add_patch(Rectangle((back + 0.5, 0.95), 0.62 * (front - back), 0.5, fc="#dddddd", ec="black", lw=0.8))
    axes.plot([0.0, 2.7], [0.32, 0.32], "o", color="black", ms=11)
    axes.axhspan(-1.0, 0.0, color="#8c7b6b", zorder=3)
    axes.set(xlim=(-18, 22), ylim=(-0.4, 5.0), aspect="equal")
    axes.set(xlabel="metres ahead of the rear axle", ylabel="height (m)")
    axes.set_title(
        "from the side: vertical fields of view of the cameras that look ahead or back, beams of the LiDARs",
        fontsize=10,
    )


def _slopes(mount: Mount) -> list[tuple[int, NDArray[np.float64]]]:
    """Ahead (+1) and back (-1), if the sensor covers that way: the slopes of its elevations over the ground, ascending."""
    if not len(mount.elevations_deg):
        return []
    low, high = mount.azimuth_range_deg
    yaw = mount.rotation_deg[2]
    pitch = np.arcsin(np.clip(mount.ego_T_body[2, 0], -1, 1)) * np.cos(
        np.radians(yaw)
    )  # of the plane through ahead and up
    found = []
    for ahead, azimuth in ((1, 0.0), (-1, 180.0)):
        if (azimuth - yaw - low) % 360 <= high - low:
            found.append((ahead, np.tan(ahead * pitch + np.radians(mount.elevations_deg))))
    return found


def _car(axes: Any) -> None:
    (back, front), (right, left) = EGO_OUTLINE
    axes.add_patch(
        Rectangle((-left, back), left - right, front - back, fc="#f4f4f4", ec="black", lw=1, alpha=0.8, zorder=2)
    )
    axes.add_patch(Polygon([(-0.5, front - 0.8), (0.5, front - 0.8), (0, front - 0.2)], fc="black", zorder=2))
