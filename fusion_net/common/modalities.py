"""The kinds of sensors: which one a channel is of, and how tables and charts name and colour them."""

from collections.abc import Iterable
from typing import NamedTuple


class Modality(NamedTuple):
    """How a kind of sensor is shown."""

    letter: str  # in the rows of tables: C+L+R
    label: str
    color: str  # of charts


STYLES = {
    "camera": Modality("C", "camera", "#1f77b4"),
    "lidar": Modality("L", "LiDAR", "#2ca02c"),
    "radar": Modality("R", "radar", "#e6550d"),
}


def letters(sensors: Iterable[str]) -> str:
    """A set of sensors as tables name it: C+L+R and so on."""
    return "+".join(STYLES[name].letter for name in sensors)


_OF_PREFIX = {"CAM": "camera", "LIDAR": "lidar", "RADAR": "radar"}


def modality_of(sensor: str) -> str:
    """The modality that nuScenes' channel name tells; a modality is its own."""
    return _OF_PREFIX.get(sensor.split("_")[0], sensor)
