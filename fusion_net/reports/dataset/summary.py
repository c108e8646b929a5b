"""The figures of a data set's survey as one JSON document, compared with what is published of nuScenes."""

from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fusion_net.common.modalities import STYLES
from fusion_net.common.nuscenes_format import CLASSES, MODALITIES, VISIBILITY_LEVELS
from fusion_net.reports.dataset.survey import Survey

RANGES = (0, 10, 20, 30, 40, 50, 60)
"""Edges in metres of the rings in which objects are counted."""
SPEEDS = (0.0, 0.5, 2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 45.0)
"""Edges in m/s; slower than the second is at rest."""
VISIBILITY = ("unknown", *(f"{level.removeprefix('v')} %" for level in VISIBILITY_LEVELS))

Summary = dict[str, Any]


def summarize(found: Survey) -> Summary:
    """Every figure of the page. Means over nothing are null."""
    objects = found.objects
    per_keyframe = np.bincount(objects.keyframe, minlength=len(found.scene))
    return {
        "scenes": len(set(found.scene)),
        "keyframes": len(found.scene),
        "objects": len(objects.label),
        "objects_per_keyframe": spread(per_keyframe),
        "channels": found.channels,
        "image_size": list(found.image_size),
        "layouts": dict(Counter(_first_of_each(found.scene, found.layout))),
        "conditions": _conditions(found),
        "classes": {name: _class(found, label) for label, name in enumerate(CLASSES)},
        "range_edges": list(RANGES),
        "range": _counts(objects.range, RANGES),
        "speed_edges": list(SPEEDS),
        "speed": _counts(objects.speed, SPEEDS),
        "visibility": dict(zip(VISIBILITY, np.bincount(objects.visibility, minlength=5).tolist(), strict=True)),
        "sensor_data": _keyframe_data(found),
        "nuscenes": beside_nuscenes(found),
    }


def spread(values: ArrayLike) -> Summary:
    """Mean, standard deviation, 5th, 50th and 95th percentile of what is finite."""
    numbers = np.asarray(values, float)
    numbers = numbers[np.isfinite(numbers)]
    if not len(numbers):
        return {"count": 0, "mean": None, "std": None, "p5": None, "p50": None, "p95": None}
    low, middle, high = np.percentile(numbers, [5, 50, 95]).tolist()
    return {
        "count": len(numbers), "mean": float(numbers.mean()), "std": float(numbers.std()),
        "p5": low, "p50": middle, "p95": high,
    }  # fmt: skip


def by_range(found: Survey, chosen: NDArray[np.bool_], values: NDArray) -> list[float | None]:
    """Mean value of the chosen objects (N,) in every ring of RANGES; None where there is none."""
    ring = np.digitize(found.objects.range, RANGES) - 1
    return [
        float(values[chosen & (ring == i)].mean()) if (chosen & (ring == i)).any() else None
        for i in range(len(RANGES) - 1)
    ]


def _class(found: Survey, label: int) -> Summary:
    objects = found.objects
    mine = objects.label == label
    rcs = [each.rcs_of.get(CLASSES[label], np.zeros(0)) for each in found.sensor_data]
    return {
        "objects": int(mine.sum()),
        "range": _counts(objects.range[mine], RANGES),
        "visibility": np.bincount(objects.visibility[mine], minlength=5).tolist(),
        "speed": spread(objects.speed[mine]),
        "moving": _fraction(objects.speed[mine & np.isfinite(objects.speed)] > SPEEDS[1]),
        "width": spread(objects.wlh[mine, 0]),
        "length": spread(objects.wlh[mine, 1]),
        "height": spread(objects.wlh[mine, 2]),
        "lidar_points": spread(objects.lidar_points[mine]),
        "lidar_points_by_range": by_range(found, mine, objects.lidar_points),
        "radar_points": spread(objects.radar_points[mine]),
        "radar_points_by_range": by_range(found, mine, objects.radar_points),
        "with_radar": _fraction(objects.radar_points[mine] > 0),
        "rcs": spread(np.concatenate([np.zeros(0), *rcs])),
    }


def _conditions(found: Survey) -> list[Summary]:
    """One entry per condition and severity, the mildest first."""
    kind = list(zip(found.condition, found.severity, strict=True))
    scenes = Counter(_first_of_each(found.scene, kind))
    keyframes = Counter(kind)
    objects = Counter(kind[row] for row in found.objects.keyframe.tolist())
    entries = []
    for each in sorted(keyframes, key=lambda k: (-sum(n for c, n in keyframes.items() if c[0] == k[0]), k)):
        sensor_data = [data for data in found.sensor_data if kind[data.keyframe] == each]
        entries.append(
            {
                "condition": each[0],
                "severity": each[1],
                "scenes": scenes[each],
                "keyframes": keyframes[each],
                "objects": objects[each],
                "brightness": spread([data.brightness for data in sensor_data]),
                "contrast": spread([data.contrast for data in sensor_data]),
                "lidar_points": spread([data.lidar_points for data in sensor_data]),
                "radar_returns": spread([sum(data.radar_returns) for data in sensor_data]),
            }
        )
    return entries


def _keyframe_data(found: Survey) -> Summary:
    return {
        "keyframes": len(found.sensor_data),
        "brightness": spread([each.brightness for each in found.sensor_data]),
        "lidar_points": spread([each.lidar_points for each in found.sensor_data]),
        "radar_returns_per_scan": spread([count for each in found.sensor_data for count in each.radar_returns]),
        "rcs": spread(all_returns(found, "rcs")),
        "radar_speed": spread(all_returns(found, "speed")),
    }


def all_returns(found: Survey, name: str) -> NDArray[np.float32]:
    """``rcs`` or ``speed`` of the radar returns of all keyframes that were opened."""
    return np.concatenate([np.zeros(0, np.float32), *(getattr(each, name) for each in found.sensor_data)])


def beside_nuscenes(found: Survey) -> list[list[str]]:
    """Rows of name, here, nuScenes, source: only what is published."""
    sensor_data = _keyframe_data(found)
    objects = found.objects
    near_cars = (objects.label == CLASSES.index("car")) & (objects.range < 50) & (objects.radar_points > 0)
    cars = spread(objects.radar_points[near_cars])
    sensors = ", ".join(f"{len(found.channels[name])} {STYLES[name].label}" for name in MODALITIES)
    width, height = found.image_size
    return [
        ["sensors", sensors, "6 camera, 1 LiDAR, 5 radar", "nuScenes paper"],
        ["image", f"{width} x {height}" if width else "none", "1600 x 900", "nuScenes paper"],
        ["LiDAR points per sweep", _pm(sensor_data["lidar_points"], 0), "about 34,000, all round", "nuScenes"],
        ["RCS of radar returns, dBsm", _pm(sensor_data["rcs"], 1), "4.8 ± 7.6", "CRN's normalisation"],
        ["speed of radar returns, m/s", _pm(sensor_data["radar_speed"], 2), "0.68 ± 1.98", "CRN's normalisation"],
        [
            "radar returns of a car within 50 m",
            "none" if cars["mean"] is None else f"{cars['p5']:.0f} to {cars['p95']:.0f} in a keyframe",
            "up to 40 at 10 m, 10 at 50 m, over several scans",
            "nuScenes",
        ],
    ]  # fmt: skip


def _pm(figures: Summary, decimals: int) -> str:
    if figures["mean"] is None:
        return "none"
    return f"{figures['mean']:,.{decimals}f} ± {figures['std']:,.{decimals}f}"


def _counts(values: NDArray, edges: tuple[float, ...]) -> list[int]:
    return np.histogram(values[np.isfinite(values)], edges)[0].tolist()


def _fraction(flags: NDArray[np.bool_]) -> float | None:
    return float(flags.mean()) if len(flags) else None


def _first_of_each(scenes: list[str], values: list[Any]) -> list[Any]:
    """The value of the first keyframe of every scene."""
    return list(dict(zip(reversed(scenes), reversed(values), strict=True)).values())
