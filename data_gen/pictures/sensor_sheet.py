"""One keyframe in every condition as camera, LiDAR and radar measure it: the same world, with the errors of each sensor."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from data_gen.episode import Scenario
from data_gen.pictures.sheet import Image, data_of, short_scene, single_condition, write_sheet
from data_gen.recording.capture import Firing, capture, keyframe_times
from data_gen.rig.rig import Rig
from data_gen.scene.conditions import Condition, ConditionMix
from data_gen.scene.scene import Scene
from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.boxes import Boxes, transform_boxes
from fusion_net.common.drawing import BEVPanel, label
from fusion_net.common.geometry import invert, transform

GROUND = BEVPanel(BEVGrid(x_min=-2.0, x_max=62.0, y_min=-24.0, y_max=24.0, cell=0.5), scale=5.0)
BOX_COLOR, STILL_COLOR, MOVING_COLOR = (70, 150, 70), (90, 190, 255), (255, 140, 50)
CAMERA_WIDTH = 800
FAR = 15.0
"""Metres from which LiDAR points are few and drawn larger."""
FAST = 0.5
"""Compensated radial speed in m/s from which a radar return is drawn as a moving one."""


def draw_sensors(
    path: Path, rig: Rig, scenario: Scenario, mix: ConditionMix, *, layout: str, severity: int, seed: int
) -> None:
    """Writes a row per condition: the first camera, the LiDAR and the radars from above, objects outlined, the car on the
    left looking right. LiDAR points are coloured by intensity, radar returns by whether they move, with half a second of their
    radial velocity."""
    if not (rig.cameras and rig.lidars and rig.radars):
        raise ValueError(f"rig '{rig.name}' lacks a camera, a LiDAR or a radar, and this sheet shows all three")
    rows, names = [], []
    for name in mix.weights:
        scene = short_scene(rig, layout, scenario, single_condition(mix, name, severity), seed)
        firings = [firing for firing in capture(scene, rig, keyframes=1, seed=seed) if firing.is_keyframe]
        time = float(keyframe_times(rig, 1)[0])
        boxes = _boxes(scene, time)
        panels = [_camera(firings, rig), _lidar(firings, rig, boxes), _radar(firings, rig, scene, time, boxes)]
        rows.append([_high(panel, panels[1].shape[0]) for panel in panels])
        names.append(f"{label(name)}\n{_figures(scene.condition, firings, rig)}")
    columns = ("camera", "LiDAR: colour is intensity", "radar: blue stands, orange moves")
    write_sheet(path, rows, row_names=names, column_names=columns, side=164)


def _camera(firings: list[Firing], rig: Rig) -> Image:
    image = next(data_of(firings, rig.cameras)).image
    size = (CAMERA_WIDTH, round(image.shape[0] * CAMERA_WIDTH / image.shape[1]))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_CUBIC), np.uint8)


def _lidar(firings: list[Firing], rig: Rig, boxes: Boxes) -> Image:
    ground = GROUND.canvas()
    GROUND.boxes(ground, boxes, BOX_COLOR)
    for lidar, sweep in zip(rig.lidars.values(), data_of(firings, rig.lidars), strict=True):
        points = transform(lidar.ego_T_sensor, sweep.points)
        level = np.clip(255 * np.sqrt(sweep.intensity / 100), 45, 235).astype(np.uint8)
        colors = cv2.applyColorMap(level[:, None], cv2.COLORMAP_TURBO).reshape(-1, 3)[:, ::-1]
        GROUND.points(ground, points, colors)
        far = np.hypot(points[:, 0], points[:, 1]) > FAR
        GROUND.points(ground, points[far], colors[far], radius=2)
    return _turned(ground)


def _radar(firings: list[Firing], rig: Rig, scene: Scene, time: float, boxes: Boxes) -> Image:
    ground = GROUND.canvas()
    GROUND.boxes(ground, boxes, BOX_COLOR)
    global_T_ego = scene.ego.pose(time)
    for firing in (firing for firing in firings if firing.channel in rig.radars):
        scan: Any = firing.data
        ego_T_sensor = invert(global_T_ego) @ scene.ego.pose(firing.time) @ rig.radars[firing.channel].ego_T_sensor
        points = transform(ego_T_sensor, np.stack([scan.x, scan.y, np.zeros_like(scan.x)], axis=1))
        velocity = np.stack([scan.vx_comp, scan.vy_comp], axis=1) @ ego_T_sensor[:2, :2].T
        moving = np.hypot(scan.vx_comp, scan.vy_comp) > FAST
        GROUND.points(ground, points[~moving], STILL_COLOR, radius=2)
        GROUND.points(ground, points[moving], MOVING_COLOR, radius=2)
        GROUND.arrows(ground, points[moving, :2], velocity[moving] / 2, MOVING_COLOR)
    return _turned(ground)


def _boxes(scene: Scene, time: float) -> Boxes:
    """The objects of the scene in the ego frame, without decoys."""
    actors = [actor for actor in scene.actors if actor.asset.category]
    position, yaw, velocity = (np.array(part) for part in zip(*(a.track.at(time) for a in actors), strict=True))
    size = np.array([actor.asset.size for actor in actors])
    center = position + np.stack([np.zeros(len(size)), np.zeros(len(size)), size[:, 2] / 2], axis=1)
    still = np.zeros_like(velocity[:, :2])
    boxes = Boxes.labels(center, size[:, [1, 0, 2]], yaw, still, np.zeros(len(size), np.int64))
    return transform_boxes(invert(scene.ego.pose(time)), boxes)


def _turned(ground: NDArray[np.uint8]) -> Image:
    """The panel, drawn with ahead up, turned so that ahead is to the right."""
    return np.ascontiguousarray(np.rot90(ground, -1))


def _high(image: Image, height: int) -> Image:
    """The image on black, in the middle of a tile of this height."""
    room = height - image.shape[0]
    return np.pad(image, ((room // 2, room - room // 2), (0, 0), (0, 0))) if room > 0 else image[:height]


def _figures(condition: Condition, firings: list[Firing], rig: Rig) -> str:
    """The physical conditions of the scene, and how much of it each sensor detects."""
    image = next(data_of(firings, rig.cameras)).image
    lidar, radar = ([data.body for data in data_of(firings, mounts)] for mounts in (rig.lidars, rig.radars))
    return "\n".join(
        [
            f"{condition.illuminance:,.0f} lux, sun {condition.sun_elevation:.0f}°",
            f"visibility {_metres(condition.visibility)}",
            f"rain {condition.rain_rate:.0f} mm/h, film {condition.water_film:.1f} mm",
            f"contrast {image.mean(axis=-1).std():.0f} of 255",
            f"LiDAR points {_counted(lidar)}",
            f"radar returns {_counted(radar)}",
        ]
    )


def _counted(bodies: list[NDArray[np.int32]]) -> str:
    """How many points there are and how many of them are on objects."""
    body = np.concatenate(bodies)
    return f"{len(body):,},\n    on objects {(body >= 0).sum():,}"


def _metres(distance: float) -> str:
    return f"{distance / 1000:.1f} km" if distance >= 1000 else f"{distance:.0f} m"
