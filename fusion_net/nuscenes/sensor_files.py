"""One sensor file to one array: nuScenes' images and point clouds, and the side files of generated data sets.

A file that is cut short or of another kind raises one line that names it; half an image or half a cloud is never
returned.
"""

from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from fusion_net.common.nuscenes_format import CLASS_SUFFIX, DEPTH_SUFFIX, FILE_SUFFIX, RADAR_FIELDS, TIME_SUFFIX
from fusion_net.nuscenes.kept_files import kept

LABEL_TYPES = {DEPTH_SUFFIX: "uint16", CLASS_SUFFIX: "uint8"}
"""Of the pictures beside an image: the type of a pixel, one value each."""
_PCD_KINDS = {"F": "f", "I": "i", "U": "u"}
_DEFAULT_FILTER = {"invalid_state": (0,), "dyn_prop": tuple(range(7)), "ambig_state": (3,)}


@kept
def read_lidar(path: Path) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Points (P, 5) x, y, z in the sensor frame, intensity 0..255, ring; and the time (P,) of each in seconds
    relative to the sweep's stamp, 0 where no ``.time.npy`` lies beside the ``.pcd.bin``. An empty file is an empty
    cloud."""
    data = np.fromfile(path, "<f4")
    if path.stat().st_size % 20:
        raise ValueError(f"{path} is cut short: {path.stat().st_size} bytes are no whole number of 20-byte points")
    points = data.reshape(-1, 5)
    side_file = path.with_name(path.name.removesuffix(FILE_SUFFIX["lidar"]) + TIME_SUFFIX)
    if not side_file.exists():
        return points, np.zeros(len(points), np.float32)
    try:
        time = np.load(side_file)
    except (ValueError, EOFError, OSError) as error:
        raise ValueError(f"{side_file} is damaged or cut short ({error})") from None
    if time.shape != (len(points),):
        raise ValueError(f"{side_file} holds {time.shape} times for {len(points)} points of {path.name}")
    return points, time


@kept
def read_radar(path: Path, *, default_filter: bool = False) -> NDArray[np.void]:
    """Detections as a structured array with nuScenes' 18 fields, in the sensor frame. Records of NaN (an empty scan)
    are left out; ``default_filter`` also leaves out what nuScenes' own loader does: invalid, ambiguous or unknown
    returns."""
    head, _, body = path.read_bytes().partition(b"DATA binary\n")
    layout = _pcd_layout(head)
    if layout is None:
        raise ValueError(f"{path} has no whole header of a nuScenes radar .pcd (18 binary fields)")
    dtype, count = layout
    if len(body) < count * dtype.itemsize:
        raise ValueError(f"{path} is cut short: {len(body)} bytes for {count} detections of {dtype.itemsize}")
    detections = np.frombuffer(body, dtype, count)
    keep = np.isfinite([detections[name] for name in ("x", "y", "z", "rcs", "vx_comp", "vy_comp")]).all(axis=0)
    for field, allowed in _DEFAULT_FILTER.items() if default_filter else ():
        keep &= np.isin(detections[field], allowed)
    return detections[keep]


@lru_cache(maxsize=1024)
def _pcd_layout(head: bytes) -> tuple[np.dtype, int] | None:
    """Record type and number of records that a .pcd header tells; None if it is not one of nuScenes' radars."""
    try:
        header = dict(line.split(" ", 1) for line in head.decode("ascii").splitlines() if not line.startswith("#"))
        columns = zip(header["FIELDS"].split(), header["TYPE"].split(), header["SIZE"].split(), strict=True)
        dtype = np.dtype([(name, f"<{_PCD_KINDS[kind]}{size}") for name, kind, size in columns])
        count = int(header["WIDTH"]) * int(header["HEIGHT"])
    except (ValueError, KeyError, TypeError):
        return None
    return (dtype, count) if dtype.names == tuple(name for name, _, _ in RADAR_FIELDS) else None


@kept
def read_image(path: Path, size: tuple[int, int]) -> NDArray[np.uint8]:
    """RGB image (H, W, 3) of the size (H, W) that its record says."""
    return np.asarray(cv2.cvtColor(_decode(path, cv2.IMREAD_COLOR, size), cv2.COLOR_BGR2RGB), np.uint8)


@kept
def read_labels(path: Path, suffix: str, size: tuple[int, int]) -> NDArray | None:
    """The picture ``<stem><suffix>`` of one of LABEL_TYPES beside an image of a size (H, W); None where there is none."""
    side_file = path.with_suffix(suffix)
    if not side_file.exists():
        return None
    labels = _decode(side_file, cv2.IMREAD_UNCHANGED, size)
    if labels.dtype != LABEL_TYPES[suffix] or labels.ndim != 2:
        raise ValueError(f"{side_file} is no picture of one channel of {LABEL_TYPES[suffix]}")
    return labels


def _decode(path: Path, flags: int, size: tuple[int, int]) -> NDArray:
    """Decoded picture. The end marker is looked for first, because the decoder pads a file that is cut short with
    grey; zero bytes may follow it."""
    data = path.read_bytes()
    end = b"IEND" if path.suffix == ".png" else b"\xff\xd9"
    image = cv2.imdecode(np.frombuffer(data, np.uint8), flags) if end in data.rstrip(b"\0")[-32:] else None
    if image is None:
        raise ValueError(f"{path} is damaged or cut short: {len(data)} bytes that are no whole image")
    if image.shape[:2] != size:
        found, said = (f"height={height}, width={width}" for height, width in (image.shape[:2], size))
        raise ValueError(f"{path} is an image of {found}, not of {said} as sample_data.json says")
    return image
