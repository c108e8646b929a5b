"""What no car could have: sensors under the road or behind its own walls, fields of view and rates that are none.

Each refusal is one line: the key and its value, what is wrong, the nearest value that works as an override to type, and the
command that draws the rig.
"""

import math
import re
from collections.abc import Iterator
from typing import NamedTuple

from data_gen.rig.mounts import Camera, Lidar, Mount, Radar
from data_gen.rig.sensor_suite import ALL, SensorSuite
from data_gen.road.ego import EGO_OUTLINE
from fusion_net.common.cli.command_line import command_line
from fusion_net.common.nuscenes_format import REFERENCE

LOWEST = 0.1
"""Least height of a sensor over the road in metres."""
OPAQUE = {"cameras": 0.9, "lidars": 1.5, "radars": 1.5}
"""Height in metres up to which the body stops what a sensor sends or sees: cameras look out of windows."""
WALL = 0.8
"""Metres of the body that may lie before a sensor: bumpers are hollow, and 77 GHz passes plastic."""
HFOV_DEG, LARGEST = (1.0, 170.0), 8192
"""Horizontal fields of view in degrees that a pinhole has; most pixels of an image's side."""
MAX_JITTER = 4.0
"""Standard deviations, each a tenth of a period at most, that a firing is at most early or late: none overtakes another."""
EPISODE_LEAD = 1.0
"""Seconds that an episode has before its keyframes, for the sweeps that come before the first."""
PREFIX = {"cameras": "CAM_", "lidars": "LIDAR_", "radars": "RADAR_"}


class Problem(NamedTuple):
    """A value that cannot be. ``key`` is below ``rig``; ``nearest`` None where no value of that key would do."""

    key: str
    value: object
    why: str
    nearest: object | None


def check_rig(rig: SensorSuite) -> None:
    """Raises ValueError for the first thing that cannot be."""
    for key, value, why, nearest in _problems(rig):
        what = f"{key}={_text(value)}" if value is not None else key
        mend = f"; the nearest that works is rig.{key}={_text(nearest)}" if nearest is not None else ""
        raise ValueError(
            f"{what} {why}{mend}; to see the rig: {command_line('-m data_gen.pictures.rig_preview', rig=rig.name)}"
        )


def _problems(rig: SensorSuite) -> Iterator[Problem]:
    if not 0 < rig.keyframe_rate < math.inf:
        yield Problem("keyframe_rate", rig.keyframe_rate, "Hz gives no keyframes", 2.0)
    if not rig.sensors:
        yield Problem("cameras, lidars, radars", None, "are all empty: a rig needs a sensor, LIDAR_TOP at least", None)
    for group in PREFIX:
        for channel, mount in getattr(rig, group).items():
            yield from _named(group, channel)
            for key, value, why, nearest in _of_mount(group, mount, rig.keyframe_rate):
                yield Problem(f"{group}.{channel}.{key}", value, why, nearest)
    if REFERENCE not in rig.lidars:
        yield Problem(
            "lidars", None, f"has no {REFERENCE}: a nuScenes sample takes its time and its pose from it; add one", None
        )
    yield from _twins(rig)
    yield from _timing(rig)


def _named(group: str, channel: str) -> Iterator[Problem]:
    prefix = PREFIX[group]
    if not re.fullmatch(f"{prefix}[A-Z0-9_]*[A-Z0-9]", channel):
        rest = re.sub("[^A-Z0-9]+", "_", channel.upper().removeprefix(prefix.rstrip("_")).strip("_")) or "FRONT"
        why = f"is no name of nuScenes for it, {prefix}...: call it {prefix}{rest.removeprefix(prefix)}"
        yield Problem(f"{group}.{channel}", None, why, None)


def _of_mount(group: str, mount: Mount, keyframe_rate: float) -> Iterator[Problem]:
    for key, usual in (("translation", [0.0, 0.0, 1.5]), ("rotation_deg", [0.0, 0.0, 0.0])):
        value = getattr(mount, key)
        if len(value) != 3 or not all(map(math.isfinite, value)):
            finite = [v for v in value if math.isfinite(v)][:3]
            yield Problem(key, value, "is not three numbers", finite + usual[len(finite) :])
            return
    x, y, z = mount.translation
    if z < LOWEST:
        where = "is under the ground" if z < 0 else f"is less than {LOWEST} m over the ground"
        yield Problem("translation", mount.translation, where, [x, y, OPAQUE[group] if _in_outline(x, y) else LOWEST])
    yield from _enclosed(group, mount)
    if not keyframe_rate <= mount.rate < math.inf:
        why = f"Hz gives no reading for every keyframe ({keyframe_rate:g} Hz)"
        yield Problem("rate", mount.rate, why, keyframe_rate)
    elif not 0 <= mount.phase < 1 / mount.rate:
        phase = round(mount.phase % (1 / mount.rate), 5) if math.isfinite(mount.phase) else 0.0
        yield Problem("phase", mount.phase, f"s is not within a period, [0, {1 / mount.rate:.4g})", phase)
    elif not 0 <= mount.jitter <= 0.1 / mount.rate:
        most = 0.1 / mount.rate
        nearest = most if mount.jitter > most else 0.0
        yield Problem("jitter", mount.jitter, f"s is not within a tenth of a period, [0, {most:.4g}]", nearest)
    yield from {"cameras": _of_camera, "lidars": _of_lidar, "radars": _of_radar}[group](mount)  # type: ignore[operator]


def _enclosed(group: str, mount: Mount) -> Iterator[Problem]:
    """A sensor inside the body that looks through more of it than a bumper."""
    x, y, z = mount.translation
    (back, front), (right, left) = EGO_OUTLINE
    if not _in_outline(x, y) or z >= OPAQUE[group]:
        return
    forward, sideways = mount.ego_T_body[:2, 0].tolist()
    ways = [((front if forward > 0 else back) - x) / forward] if abs(forward) > 1e-6 else []
    ways += [((left if sideways > 0 else right) - y) / sideways] if abs(sideways) > 1e-6 else []
    way = min(ways, default=math.inf)  # straight up or down: never out
    if way > WALL:
        is_level = math.isfinite(way)
        out = [round(x + way * forward, 2), round(y + way * sideways, 2), z] if is_level else [x, y, OPAQUE[group]]
        length = f"through {way:.1f} m of" if is_level else "into"
        yield Problem("translation", mount.translation, f"looks {length} the car's own body", out)


def _in_outline(x: float, y: float) -> bool:
    (back, front), (right, left) = EGO_OUTLINE
    return back < x < front and right < y < left


def _of_camera(camera: Camera) -> Iterator[Problem]:
    low, high = HFOV_DEG
    if not low <= camera.hfov_deg <= high:
        nearest = high if camera.hfov_deg > high else low
        yield Problem(
            "hfov_deg", camera.hfov_deg, f"is no field of view of a pinhole camera, [{low:g}, {high:g}]", nearest
        )
    for key in ("width", "height"):
        value = getattr(camera, key)
        if not 1 <= value <= LARGEST:
            yield Problem(key, value, f"is not a number of pixels, [1, {LARGEST}]", min(max(value, 1), LARGEST))
    if camera.principal is not None:
        for at, size in zip(camera.principal, (camera.width, camera.height), strict=False):
            if len(camera.principal) != 2 or not -size <= at <= 2 * size:
                middle = [camera.width / 2, camera.height / 2]
                yield Problem("principal", camera.principal, "is not a pixel (u, v) in or near the image", middle)
                return


def _of_lidar(lidar: Lidar) -> Iterator[Problem]:
    low, high = (*lidar.sector_deg, math.nan, math.nan)[:2]
    if len(lidar.sector_deg) != 2 or not (low < high <= low + 360 and abs(low) <= 360):
        turned = [high, low] if high < low <= high + 360 else [-180.0, 180.0]
        yield Problem("sector_deg", lidar.sector_deg, "is no sector [low, high] of at most 360 degrees", turned)
    most = lidar.model.columns_in(1 / lidar.rate) if lidar.rate > 0 else 1
    if lidar.columns is not None and not 1 <= lidar.columns <= most:
        why = f"is not a number of columns that the {lidar.model.name} fires in a turn of 1/{lidar.rate:g} s"
        yield Problem("columns", lidar.columns, why, min(max(lidar.columns, 1), most))
    if not 0 <= lidar.crosstalk <= 1:
        yield Problem("crosstalk", lidar.crosstalk, "is not within [0, 1]", min(max(lidar.crosstalk, 0.0), 1.0))
    if not math.isfinite(lidar.cut_deg):
        yield Problem("cut_deg", lidar.cut_deg, "is no angle", 105.0)


def _of_radar(radar: Radar) -> Iterator[Problem]:
    if not 0 < radar.fov_deg <= 90:
        nearest = 90.0 if radar.fov_deg > 90 else 1.0
        yield Problem("fov_deg", radar.fov_deg, "is no half-angle of a field of view, (0, 90]", nearest)
    yield from _positive(
        radar, max_range=1.0, range_resolution=0.1, azimuth_resolution_deg=0.5, doppler_resolution=0.05, max_doppler=1.0
    )


def _positive(mount: Mount, **least: float) -> Iterator[Problem]:
    for key, low in least.items():
        value = getattr(mount, key)
        if not low <= value < math.inf:
            yield Problem(key, value, f"is less than {low:g} or endless", low)


def _twins(rig: SensorSuite) -> Iterator[Problem]:
    for group in PREFIX:
        before: list[tuple[str, Mount]] = []
        for channel, mount in getattr(rig, group).items():
            for other, twin in before:
                if mount == twin:
                    why = f"is {other} again, in the same place with the same view: move it, turn it or leave it out"
                    yield Problem(f"{group}.{channel}", None, why, None)
            before.append((channel, mount))


def _timing(rig: SensorSuite) -> Iterator[Problem]:
    rate, clock = rig.keyframe_rate, rig.lidars[REFERENCE]
    turns = max(1, round(clock.rate / rate))
    if not math.isclose(rate * turns, clock.rate, rel_tol=1e-6):
        why = (
            f"Hz is not reached: keyframes are ends of {REFERENCE}'s turns, of which there are {clock.rate:g} a second"
        )
        yield Problem("keyframe_rate", rate, why, round(clock.rate / turns, 6))
        return
    for modality, count in rig.sweeps.items():
        group = f"{modality}s"
        if group not in PREFIX:
            yield Problem(f"sweeps.{modality}", count, "is no modality; there are camera, lidar, radar", None)
            return
        if isinstance(count, str) and count != ALL:
            yield Problem(f"sweeps.{modality}", count, f"is neither a number of firings nor {ALL}", ALL)
            return
        slowest = min((mount.rate for mount in getattr(rig, group).values()), default=1e9)
        most = int((EPISODE_LEAD - 1 / clock.rate) * slowest) - 1
        why = f"within the {EPISODE_LEAD:g} s before the first keyframe"
        if isinstance(count, str):
            if most < 0:
                yield Problem(f"sweeps.{modality}", count, f"does not fit {why}", 0)
        elif not 0 <= count <= max(most, 0):
            yield Problem(
                f"sweeps.{modality}", count, f"is not a number of firings {why}", min(max(count, 0), max(most, 0))
            )
    yield from _unread_keyframes(rig)


def _unread_keyframes(rig: SensorSuite) -> Iterator[Problem]:
    """Sensors so slow and so irregular that none of their firings may lie between two keyframes."""
    clock = rig.lidars[REFERENCE]
    shortest = 1 / rig.keyframe_rate - 2 * MAX_JITTER * clock.jitter
    for channel, mount in rig.sensors.items():
        longest = 1 / mount.rate + 2 * MAX_JITTER * mount.jitter
        if mount is clock or longest <= shortest * (1 + 1e-6):
            continue
        key = f"{next(group for group in PREFIX if channel in getattr(rig, group))}.{channel}"
        why = f"leaves keyframes without a reading: its firings are up to {longest:.4g} s apart, keyframes {shortest:.4g} s"
        steadiest = (shortest - 1 / mount.rate) / (2 * MAX_JITTER)
        if steadiest >= 0:
            yield Problem(f"{key}.jitter", mount.jitter, f"s {why}", math.floor(steadiest * 1e6 + 1e-3) / 1e6)
        else:
            yield Problem(f"{key}.rate", mount.rate, f"Hz {why}", math.ceil(1e4 / shortest - 1e-3) / 1e4)


def _text(value: object) -> str:
    """A value as an override is typed."""
    return str(value).replace(" ", "")
