"""The pictures of an answer: what the camera saw, the ground from above. Boxes lie over them as SVG (``overlay``)."""

import cv2
import numpy as np

from fusion_lab.engine.answers import Answer
from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.drawing import BEVPanel, Image, points_on_image

SCALE = 3
"""Of a camera's image."""
LIDAR, RADAR = (150, 150, 160), (90, 190, 255)
RADAR_SECONDS = 0.5
"""Of its velocity that a radar point's arrow shows."""


def jpeg(image: Image, quality: int = 88) -> bytes:
    """An RGB image as a file."""
    done, encoded = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
    assert done
    return encoded.tobytes()


def panel_of(grid: BEVGrid) -> BEVPanel:
    """The ground from above, about 560 pixels high."""
    return BEVPanel(grid, scale=560 / (grid.x_max - grid.x_min))


def camera_picture(answer: Answer, *, points: bool = False) -> Image:
    """The images side by side, enlarged; ``points``: with the LiDAR's on them, by their depth."""
    images = []
    for image, cam_K, ego_T_cam in zip(answer.sample.images, answer.sample.cam_K, answer.sample.ego_T_cam, strict=True):
        height, width = image.shape[:2]
        large = np.asarray(cv2.resize(image, (SCALE * width, SCALE * height), interpolation=cv2.INTER_CUBIC), np.uint8)
        if points:
            lidar = answer.sample.lidar_points
            points_on_image(large, lidar, cam_K=cam_K, ego_T_cam=ego_T_cam, scale=SCALE, radius=2)
        images.append(large)
    return np.concatenate(images, axis=1) if images else np.zeros((96 * SCALE, 320 * SCALE, 3), np.uint8)


def ground_picture(answer: Answer) -> Image:
    """The ground from above with the points of LiDAR and radar."""
    panel, sample = panel_of(answer.grid), answer.sample
    image = panel.canvas()
    panel.points(image, sample.lidar_points[:, :2], LIDAR)
    panel.points(image, sample.radar_points[:, :2], RADAR, radius=3)
    panel.arrows(image, sample.radar_points[:, :2], RADAR_SECONDS * sample.radar_points[:, 4:6], RADAR)
    return image
