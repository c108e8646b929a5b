"""LiDAR and radar files exactly as nuScenes writes them."""

from pathlib import Path

import numpy as np

from data_gen.sensors.lidar.lidar import LidarSweep
from data_gen.sensors.radar.flags import UNAMBIGUOUS
from data_gen.sensors.radar.radar import RadarScan
from fusion_net.common.nuscenes_format import CAUSE_SUFFIX, FILE_SUFFIX, RADAR_FIELDS, TIME_SUFFIX

RADAR_DTYPE = np.dtype([(name, f"<{'f' if kind == 'F' else 'i'}{size}") for name, kind, size in RADAR_FIELDS])


def write_lidar(path: Path, sweep: LidarSweep) -> None:
    """``.pcd.bin``: float32 x, y, z (LIDAR_TOP frame), intensity 0..255, ring; each point's time beside it as ``.npy``."""
    columns = np.column_stack([sweep.points, sweep.intensity, sweep.ring]).astype("<f4")
    path.write_bytes(columns.tobytes())
    np.save(path.with_name(path.name.removesuffix(FILE_SUFFIX["lidar"]) + TIME_SUFFIX), sweep.time.astype("<f4"))


def write_radar(path: Path, scan: RadarScan) -> None:
    """``.pcd`` with nuScenes' 18 fields. An empty scan is one record of NaN, and a byte follows the records, because the
    devkit's loader asserts both. ``.cause.npy`` beside it has what truly caused each detection, a code of
    ``radar.detection``; ``ambig_state``, ``invalid_state`` and ``pdh0`` are what the sensor thinks."""
    count = len(scan.x)
    records = np.zeros(max(count, 1), RADAR_DTYPE)
    if count:
        for name in (
            "x", "y", "rcs", "vx", "vy", "vx_comp", "vy_comp", "dyn_prop", "ambig_state", "invalid_state", "pdh0",
        ):  # fmt: skip
            records[name] = getattr(scan, name)
        records["id"] = np.arange(count)
    else:
        records["x"], records["ambig_state"] = np.nan, UNAMBIGUOUS
    records["is_quality_valid"] = 1
    names, kinds, sizes = zip(*RADAR_FIELDS, strict=True)
    header = [
        "# .PCD v0.7 - Point Cloud Data file format",
        "VERSION 0.7",
        f"FIELDS {' '.join(names)}",
        f"SIZE {' '.join(map(str, sizes))}",
        f"TYPE {' '.join(kinds)}",
        f"COUNT {' '.join('1' for _ in names)}",
        f"WIDTH {len(records)}",
        "HEIGHT 1",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {len(records)}",
        "DATA binary",
    ]
    path.write_bytes("\n".join(header).encode() + b"\n" + records.tobytes() + b"\n")
    np.save(path.with_suffix(CAUSE_SUFFIX), scan.cause)
