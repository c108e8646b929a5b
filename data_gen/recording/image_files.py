"""Images as they are written: a camera's JPEG with exact depth and class beside it, and the map of a scene."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from data_gen.sensors.camera.camera import CameraFrame
from fusion_net.common.nuscenes_format import CLASS_SUFFIX, DEPTH_SCALE, DEPTH_SUFFIX

JPEG_QUALITY = 92


def write_camera(path: Path, frame: CameraFrame, classes: NDArray[np.uint8]) -> None:
    """``.jpg``, ``.depth.png`` and ``.class.png``. ``classes``: the value of the class image for each body index; WORLD and
    NOTHING index from the end."""
    _write_image(path, frame.image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    depth = np.where(frame.depth * DEPTH_SCALE < 65_535, np.round(frame.depth * DEPTH_SCALE), 0)
    fast = [cv2.IMWRITE_PNG_COMPRESSION, 1]
    _write_image(path.with_suffix(DEPTH_SUFFIX), depth.astype(np.uint16), fast)
    _write_image(path.with_suffix(CLASS_SUFFIX), classes[frame.body], fast)


def write_map(path: Path, drivable: NDArray[np.bool_]) -> None:
    """The mask (rows along y, columns along x) of what can be driven on, top row last, as an image."""
    mask = drivable.view(np.uint8)
    cv2.flip(mask, 0, mask)  # image rows run down, y runs up
    # 255 is the devkit's foreground: it reads a picture of one bit a pixel as 0 and 1 and then finds no road.
    fast = [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_NONE]
    _write_image(path, mask * np.uint8(255), fast)


def _write_image(path: Path, image: np.ndarray, options: list[int]) -> None:
    ok, encoded = cv2.imencode(path.suffix, image, options)
    if not ok:
        raise OSError(f"could not encode {path.name}")
    path.write_bytes(encoded.tobytes())
