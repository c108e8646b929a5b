"""One call for every sensor: a scene and a capture event give data."""

from collections.abc import Iterator, Sequence
from typing import Any

from data_gen.scene.scene import Scene
from data_gen.sensors.camera import camera
from data_gen.sensors.common.data import SensorData
from data_gen.sensors.common.event import CaptureEvent
from data_gen.sensors.lidar import lidar
from data_gen.sensors.radar import radar


def sense(scene: Scene, event: CaptureEvent[Any]) -> SensorData:
    """The data of one event, before faults take any of it away."""
    return next(sense_each(scene, [event]))


def sense_each(scene: Scene, events: Sequence[CaptureEvent[Any]]) -> Iterator[SensorData]:
    """The data of each event, one after the other as they are asked for; radars are cast together, which is faster."""
    scans = iter(radar.sense_batch(scene, [event for event in events if event.mount.modality == "radar"]))
    for event in events:
        match event.mount.modality:
            case "camera":
                yield camera.sense(scene, event)
            case "lidar":
                yield lidar.sense(scene, event)
            case "radar":
                yield next(scans)
