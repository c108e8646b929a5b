"""Draws what a rig covers: ``python -m data_gen.pictures.rig_preview rig=surround [out=FILE.png]``.

From above every sensor's place, field of view and range; close up what of the ground is covered by cameras, by LiDARs, by both
or by none; from the side the LiDAR's beams and the cameras' vertical fields of view. The sensors are listed on the terminal.
"""

import math
import textwrap
from collections.abc import Mapping

import numpy as np
from omegaconf import DictConfig

from data_gen.pictures.rig_drawing import draw
from data_gen.rig.coverage import gaps
from data_gen.rig.mounts import Mount
from data_gen.rig.rig import Rig
from fusion_net.common.cli.command import build, command
from fusion_net.common.drawing import picture_file


def table(rig: Rig) -> str:
    """The sensors, one per line, then the beams of the LiDARs, then the gaps."""
    lines = [
        f"{'channel':18}{'place x y z (m)':>20}{'yaw':>7}{'view (deg)':>15}{'pixels, beams':>15}"
        f"{'range m':>9}{'rate Hz':>9}{'phase ms':>10}{'ground from m':>15}"
    ]
    for channel, mount in rig.sensors.items():
        low, high = mount.azimuth_range_deg
        view = f"{high - low:.1f}" + (f" x {np.ptp(mount.elevations_deg):.1f}" if len(mount.elevations_deg) else "")
        size = " x ".join(map(str, mount.resolution or ()))
        place = " ".join(f"{value:.2f}" for value in mount.translation)
        lines.append(
            f"{channel:18}{place:>20}{mount.rotation_deg[2]:7.1f}{view:>15}{size:>15}"
            f"{_or_dash(mount.max_range, 0):>9}{mount.rate:9.0f}{1e3 * mount.phase:10.1f}"
            f"{_or_dash(mount.nearest_ground, 1):>15}"
        )
    for channel, lidar in rig.lidars.items():
        lines.append(f"{channel}: {lidar.model.name}, {lidar.model.beams} beams, degrees from the lowest up:")
        angles = " ".join(f"{angle:g}" for angle in lidar.elevations_deg)
        lines += textwrap.wrap(angles, width=120, initial_indent="  ", subsequent_indent="  ")
    lines += [_blind("cameras", rig.cameras), _blind("LiDARs", rig.lidars), _blind("radars", rig.radars)]
    return "\n".join(lines)


def _or_dash(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else "-"


def _blind(kind: str, mounts: Mapping[str, Mount]) -> str:
    """One line: how much of the circle the sensors of a kind cover, and where they have gaps."""
    if not mounts:
        return f"no {kind}"
    edges = [(mount.rotation_deg[2], *mount.azimuth_range_deg) for mount in mounts.values()]
    found = [gap for gap in gaps([(yaw + low, yaw + high) for yaw, low, high in edges]) if gap[1] - gap[0] > 0.05]
    covered = 360 - sum(high - low for low, high in found)
    turn = [f"{(low + 180) % 360 - 180:.0f} to {(high + 180) % 360 - 180:.0f}" for low, high in found]
    return f"{kind} see {covered:.0f} of 360 degrees" + (f"; blind from {', '.join(turn)} degrees" if found else "")


@command(config_name="rig_preview")
def main(cfg: DictConfig) -> None:
    """Prints the table of ``cfg.rig`` and writes its picture to ``cfg.out``."""
    out = picture_file(cfg.out)
    rig = build(cfg.rig, "rig")
    print(table(rig))
    draw(rig, out)
    print(out)


if __name__ == "__main__":
    main()
