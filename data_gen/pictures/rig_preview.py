"""Draws what a rig covers: ``python -m data_gen.pictures.rig_preview rig=surround [out=FILE.png]``.

From above every sensor's place, field of view and range; close up what of the ground is seen by cameras, by LiDARs, by both
or by none; from the side the LiDAR's beams and the cameras' vertical fields. The sensors are listed on the terminal.
"""

from collections.abc import Mapping

import numpy as np
from omegaconf import DictConfig

from data_gen.pictures.picture_file import picture_file
from data_gen.rig.coverage import gaps, nearest_ground, sector_deg
from data_gen.rig.rig import Camera, Lidar, Mount, Radar, Rig
from data_gen.sensors.lidar.lidar import ELEVATION_DEG
from fusion_net.common.cli.command import build, command


def table(rig: Rig) -> str:
    """The sensors, a line each."""
    lines = [
        f"{'channel':18}{'place x y z (m)':>20}{'yaw':>7}{'view (deg)':>15}{'pixels, beams':>15}"
        f"{'range m':>9}{'rate Hz':>9}{'phase ms':>10}{'ground from m':>15}"
    ]
    for channel, mount in rig.sensors.items():
        low, high = sector_deg(mount)
        view, size, ground, reach = f"{high - low:.1f}", "", "-", "-"
        if isinstance(mount, Camera):
            K = mount.cam_K
            tall = np.degrees(np.arctan(K[1, 2] / K[1, 1]) + np.arctan((mount.height - K[1, 2]) / K[1, 1]))
            view, size = f"{high - low:.1f} x {tall:.1f}", f"{mount.width} x {mount.height}"
        elif isinstance(mount, Lidar):
            view = f"{high - low:.1f} x {np.ptp(ELEVATION_DEG):.1f}"
            size = f"{len(ELEVATION_DEG)} x {round(mount.columns * (high - low) / 360)}"
        if not isinstance(mount, Radar):
            ground = f"{nearest_ground(mount):.1f}"
        if not isinstance(mount, Camera):
            reach = f"{mount.max_range:.0f}"  # type: ignore[attr-defined]
        place = " ".join(f"{value:.2f}" for value in mount.translation)
        lines.append(
            f"{channel:18}{place:>20}{mount.rotation_deg[2]:7.1f}{view:>15}{size:>15}{reach:>9}{mount.rate:9.0f}"
            f"{1e3 * mount.phase:10.1f}{ground:>15}"
        )
    lines += [_blind("cameras", rig.cameras), _blind("LiDARs", rig.lidars), _blind("radars", rig.radars)]
    return "\n".join(lines)


def _blind(kind: str, mounts: Mapping[str, Mount]) -> str:
    """One line: how much of the circle the sensors of a kind see, far off, and where they see nothing."""
    if not mounts:
        return f"no {kind}"
    edges = [(mount.rotation_deg[2], *sector_deg(mount)) for mount in mounts.values()]
    found = [gap for gap in gaps([(yaw + low, yaw + high) for yaw, low, high in edges]) if gap[1] - gap[0] > 0.05]
    seen = 360 - sum(high - low for low, high in found)
    turn = [f"{(low + 180) % 360 - 180:.0f} to {(high + 180) % 360 - 180:.0f}" for low, high in found]
    return f"{kind} see {seen:.0f} of 360 degrees" + (f"; blind from {', '.join(turn)} degrees" if found else "")


@command(config_name="rig_preview")
def main(cfg: DictConfig) -> None:
    """Prints the table of ``cfg.rig`` and writes its picture to ``cfg.out``."""
    from data_gen.pictures.rig_drawing import draw

    out = picture_file(cfg.out)
    rig = build(cfg.rig, "rig")
    print(table(rig))
    draw(rig, out)
    print(out)


if __name__ == "__main__":
    main()
