"""Paint a point: a LiDAR point is projected into the image and takes the class of the pixel that it falls on (PointPainting,
Vora et al. 2020). An offset of the calibration sends it to a pixel beside."""

import numpy as np
from numpy.typing import NDArray

from fusion_lab.engine.answers import Answer
from fusion_lab.views.content import MISSING, Content, table
from fusion_lab.views.pictures import SCALE, camera_picture
from fusion_net.common.drawing import dots, label
from fusion_net.common.geometry import from_rpy, invert, project, transform

ROAD = (120, 125, 140)
"""Colour of a point that lands on no object."""
PALETTE = np.array(
    [(80, 220, 100), (255, 170, 60), (250, 120, 200), (200, 140, 255), (255, 230, 90), (255, 90, 90), (90, 220, 230),
     (60, 150, 255), (255, 130, 90), (190, 220, 150)], np.uint8,
)  # fmt: skip
LEAST = 0.3
"""Score from which a pixel counts as on an object."""


def content(answer: Answer) -> Content:
    """The first camera's image with painted points, and one point's way in numbers."""
    image = answer.seen.image
    if image is None:
        return Content(MISSING)
    scores = image.class_logits[0, 0].float().sigmoid().numpy()  # (K, h, w)
    points = answer.sample.lidar_points[:, :3].astype(float)
    offset = answer.state.offset
    (there, ahead), (exact, _) = _pixels(answer, points, offset), _pixels(answer, points, 0.0)
    size = answer.sample.images.shape[1:3]
    visible = ahead & _inside(there, size) & _inside(exact, size)
    there, exact, points = there[visible], exact[visible], points[visible]
    paint, right = _classes(scores, there, size), _classes(scores, exact, size)
    picture = (camera_picture(answer)[:, : SCALE * size[1]] * 0.6).astype(np.uint8)
    colors = np.where(paint[:, None] >= 0, PALETTE[paint % len(PALETTE)], ROAD)
    dots(picture, there * SCALE, colors, radius=2)
    if not len(points):
        return Content("<p>No LiDAR point falls into the image: there is nothing to paint.</p>", picture)
    wanted = np.array([answer.state.u * size[1], answer.state.v * size[0]])
    chosen = int(np.linalg.norm(there - wanted, axis=1).argmin())
    mark = '<circle cx="{:.1f}" cy="{:.1f}" r="9" fill="none" stroke="{}" stroke-width="3"/>'
    overlay = mark.format(*(exact[chosen] * SCALE), "#63e06a") + mark.format(*(there[chosen] * SCALE), "#ffffff")
    changed = int((paint != right).sum())
    panel = (
        f"<p>{len(points)} points fall into the image; <strong>{changed}</strong> of them"
        f" ({changed / len(points):.0%}) get another paint than at offset 0. Click on the image to choose a point.</p>"
        + _legend(answer, paint)
        + _way(answer, points[chosen], there[chosen], paint[chosen], scores, size)
    )
    return Content(
        panel, picture, overlay, f"Camera image with {len(points)} painted LiDAR points, {changed} mis-painted"
    )


def _legend(answer: Answer, paint: NDArray) -> str:
    """The colours of the classes that points are painted with."""
    chips = [(label(answer.classes[k]), PALETTE[k % len(PALETTE)]) for k in np.unique(paint[paint >= 0])]
    spans = "".join(
        f'<span><i class="dot" style="background:rgb({red},{green},{blue})"></i>{name}</span>'
        for name, (red, green, blue) in [*chips, ("no object", ROAD)]
    )
    return f'<p class="legend">{spans}</p>'


def _way(answer: Answer, point: NDArray, pixel: NDArray, paint: int, scores: NDArray, size: tuple[int, ...]) -> str:
    """One point: in metres, in the camera's frame, in pixels, its colour."""
    cam_K, ego_T_cam = answer.sample.cam_K[0], answer.sample.ego_T_cam[0]
    x, y, z = transform(invert(_off(ego_T_cam, answer.state.offset)), point[None])[0]
    shift = cam_K[0, 0] * np.tan(np.radians(answer.state.offset))
    at = scores[:, *_cell(scores, pixel[None], size)[0]]
    best = ", ".join(f"{label(answer.classes[k])} {at[k]:.2f}" for k in np.argsort(-at)[:3])
    name = label(answer.classes[paint]) if paint >= 0 else f"no object (no score above {LEAST:g})"
    rows = [
        ("point, car's frame", f"{point[0]:z.2f} m ahead, {point[1]:z.2f} m left, {point[2]:z.2f} m up"),
        ("in the camera's frame", f"x {x:z.2f}, y {y:z.2f}, z {z:z.2f} m"),
        ("pixel", f"u = {cam_K[0, 0]:.0f}·x/z + {cam_K[0, 2]:.0f} = {pixel[0]:.0f}, v = {pixel[1]:.0f}"),
        ("shift by the offset", f"f·tan({answer.state.offset:g}°) = {shift:.1f} pixels, at any distance"),
        ("scores there", best),
        ("paint", name),
    ]
    return table(rows, caption="One point")


def _off(ego_T_cam: NDArray, degrees: float) -> NDArray[np.float64]:
    """The mount as it is believed to be when it is ``degrees`` of yaw off."""
    turned = from_rpy(0.0, 0.0, np.radians(degrees)) @ ego_T_cam
    turned[:3, 3] = ego_T_cam[:3, 3]
    return turned


def _pixels(answer: Answer, points: NDArray, degrees: float) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Pixels (P, 2) of ego points (P, 3), and which of them are ahead of the camera."""
    cam_T_ego = invert(_off(answer.sample.ego_T_cam[0], degrees))
    pixels, depth = project(answer.sample.cam_K[0], transform(cam_T_ego, points))
    return pixels, depth > 0.5


def _inside(pixels: NDArray, size: tuple[int, ...]) -> NDArray[np.bool_]:
    height, width = size
    return (pixels >= 0).all(axis=1) & (pixels[:, 0] < width) & (pixels[:, 1] < height)


def _cell(scores: NDArray, pixels: NDArray, size: tuple[int, ...]) -> NDArray[np.int64]:
    """Row and column (P, 2) of the score map at pixels (P, 2) of an image of ``size``."""
    stride = size[0] / scores.shape[1]
    return np.floor(pixels[:, ::-1] / stride).astype(np.int64)


def _classes(scores: NDArray, pixels: NDArray, size: tuple[int, ...]) -> NDArray[np.int64]:
    """The class (P,) at each pixel, -1 where no score reaches LEAST."""
    row, column = _cell(scores, pixels, size).T
    at = scores[:, row, column]
    return np.where(at.max(axis=0) >= LEAST, at.argmax(axis=0), -1) if at.size else np.zeros(0, np.int64)
