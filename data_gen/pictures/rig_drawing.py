"""The picture of a rig's coverage: from above every sensor's place, field of view and range; close up what of the ground is
seen; from the side the LiDARs' beams and the cameras' vertical fields."""

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib import pyplot
from matplotlib.colors import ListedColormap
from matplotlib.patches import Patch, Polygon, Rectangle, Wedge

from data_gen.rig.coverage import sector_deg, sees
from data_gen.rig.rig import Camera, Lidar, Mount, Radar, Rig
from data_gen.rig.rig_checks import BODY
from data_gen.sensors.lidar.lidar import ELEVATION_DEG

matplotlib.use("Agg")

COLORS = {Camera: "#1f77b4", Lidar: "#2ca02c", Radar: "#e6550d"}
FILL = {Camera: 0.22, Lidar: 0.08, Radar: 0.07}
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
        low, high = sector_deg(mount)
        yaw, radius = mount.rotation_deg[2], getattr(mount, "max_range", CAMERA_REACH)
        x, y, _ = mount.translation
        color, style = COLORS[type(mount)], "-" if isinstance(mount, Camera) else ":"
        span = {"theta1": 90 + yaw + low, "theta2": 90 + yaw + high}
        axes.add_patch(Wedge((-y, x), radius, **span, color=color, alpha=FILL[type(mount)], lw=0))
        axes.add_patch(Wedge((-y, x), radius, **span, fill=False, ec=color, lw=0.9, ls=style))
        reach = max(reach, radius)
        if not isinstance(mount, Lidar):
            turn, at = np.radians(90 + yaw + (low + high) / 2), (0.72 if isinstance(mount, Camera) else 0.9) * radius
            aside = (
                0.0 if isinstance(mount, Camera) else 0.15 * radius * np.sign(round(y, 1))
            )  # the back ones look alike
            place = (-y + at * np.cos(turn) - aside, x + at * np.sin(turn))
            name = channel.partition("_")[2].replace("_", "\n")
            axes.annotate(name, place, ha="center", va="center", fontsize=7, color=color)
    _car(axes)
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
    axes.set(xlabel="left  <  metres  >  right", ylabel="metres ahead")
    axes.set_title(f"fields of view: cameras (blue) to {CAMERA_REACH:.0f} m, LiDARs green, radars orange", fontsize=10)


def _near(axes: Any, rig: Rig) -> None:
    """What of the ground around the car is seen, and where the sensors sit."""
    steps = np.arange(-NEAR + CELL / 2, NEAR, CELL)
    x, y = np.meshgrid(steps + np.mean(BODY[0]), steps, indexing="ij")  # rows run ahead
    points = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    seen = [
        np.any([np.zeros(len(points), bool), *(sees(mount, points) for mount in mounts)], axis=0)
        for mounts in (rig.cameras.values(), rig.lidars.values())
    ]
    level = (seen[0] + 2 * seen[1]).reshape(x.shape)[:, ::-1]  # left on the left
    extent = (steps[0], steps[-1], x[0, 0], x[-1, 0])
    shown = ListedColormap(list(GROUND.values()))(level / 3.0)
    axes.imshow(shown, origin="lower", extent=extent, interpolation="nearest")
    for mount in rig.sensors.values():
        (x0, y0, _), ahead = mount.translation, mount.ego_T_body[:2, 0]
        color = COLORS[type(mount)]
        tip = (-y0 - 1.1 * ahead[1], x0 + 1.1 * ahead[0])
        axes.annotate("", tip, (-y0, x0), arrowprops={"arrowstyle": "->", "color": color})
        axes.plot(-y0, x0, "o", color=color, ms=5, mec="white", mew=0.6)
    _car(axes)
    handles = [Patch(fc=color, ec="grey", label=label) for label, color in GROUND.items()]
    axes.legend(handles=handles, fontsize=7, loc="lower right", framealpha=0.9)
    axes.set(xlabel="left  <  metres  >  right")
    axes.set_title("ground seen around the car", fontsize=10)


def _side(axes: Any, rig: Rig) -> None:
    """Beams and vertical fields over the ground, of the sensors that look ahead (to the right) or back."""
    far = np.array([0.0, 30.0])
    for mount in rig.sensors.values():
        x, _, z = mount.translation
        color = COLORS[type(mount)]
        for ahead, low, high in _edges(mount):
            for angle in {low, high}:
                end = min(far[1], z / -np.tan(angle)) if angle < -1e-3 else far[1]
                line = {"lw": 1.1} if low < high else {"lw": 0.5, "alpha": 0.45}
                axes.plot([x, x + ahead * end], [z, z + end * np.tan(angle)], color=color, **line)
            if low < high:
                span = (z + far * np.tan(low), z + far * np.tan(high))
                axes.fill_between(x + ahead * far, *span, color=color, alpha=0.10, lw=0)
        axes.plot(x, z, "o", color=color, ms=4, mec="white", mew=0.6, zorder=5)
    (back, front), _ = BODY
    axes.add_patch(Rectangle((back, 0.25), front - back, 0.7, fc="#dddddd", ec="black", lw=0.8))
    axes.add_patch(Rectangle((back + 0.5, 0.95), 0.62 * (front - back), 0.5, fc="#dddddd", ec="black", lw=0.8))
    axes.plot([0.0, 2.7], [0.32, 0.32], "o", color="black", ms=11)
    axes.axhspan(-1.0, 0.0, color="#8c7b6b", zorder=3)
    axes.set(xlim=(-18, 22), ylim=(-0.4, 5.0), aspect="equal")
    axes.set(xlabel="metres ahead of the rear axle", ylabel="height (m)")
    axes.set_title(
        "from the side: vertical fields of the cameras that look ahead or back, beams of the LiDARs", fontsize=10
    )


def _edges(mount: Mount) -> list[tuple[float, float, float]]:
    """What the side view draws: direction (+1 ahead, -1 back), lower and upper elevation in radians. A beam has no height."""
    pitch = float(np.arcsin(np.clip(mount.ego_T_body[2, 0], -1, 1)))
    if isinstance(mount, Camera):
        if abs(mount.ego_T_body[0, 0]) < 0.7:  # looks sideways
            return []
        K = mount.cam_K
        low, high = -np.arctan((mount.height - K[1, 2]) / K[1, 1]), np.arctan(K[1, 2] / K[1, 1])
        return [(float(np.sign(mount.ego_T_body[0, 0])), pitch + low, pitch + high)]
    if not isinstance(mount, Lidar):
        return []
    x, y, z = mount.translation
    directions = [s for s in (1.0, -1.0) if sees(mount, [[x + s, y, z]])[0]]
    beams, tilt = np.radians(ELEVATION_DEG), pitch * np.cos(np.radians(mount.rotation_deg[2]))
    return [(ahead, ahead * tilt + beam, ahead * tilt + beam) for ahead in directions for beam in beams]


def _car(axes: Any) -> None:

    (back, front), (right, left) = BODY
    axes.add_patch(
        Rectangle((-left, back), left - right, front - back, fc="#f4f4f4", ec="black", lw=1, alpha=0.8, zorder=2)
    )
    axes.add_patch(Polygon([(-0.5, front - 0.8), (0.5, front - 0.8), (0, front - 0.2)], fc="black", zorder=2))
