"""What a scene's tables say of its conditions, and of each sensor: alive, dead, askew, or with a clock that is off."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from fusion_net.common.nuscenes_format import TRUE_ROTATION, TRUE_TIMESTAMP, TRUE_TRANSLATION
from fusion_net.nuscenes.nuscenes import NuScenes
from fusion_net.nuscenes.table_fields import Record
from fusion_net.viz.rerun_log.readings import Scene

SOUND = "sound"


@dataclass(frozen=True)
class Change:
    """From this keyframe on a sensor is in another state than before."""

    keyframe: int
    channel: str
    state: str

    @property
    def is_fault(self) -> bool:
        """Whether something is wrong with it."""
        return self.state != SOUND


def changes(scene: Scene) -> list[Change]:
    """The state of every sensor at the first keyframe, and each change of it, by keyframe."""
    found, last = [], dict.fromkeys(scene.channels, "")
    for number, token in enumerate(scene.tokens):
        for channel in scene.channels:
            state = state_of(scene.nusc, scene.nusc.keyframes[token].get(channel))
            if state != last[channel]:
                found.append(Change(number, channel, state))
                last[channel] = state
    return found


def state_of(nusc: NuScenes, record: Record | None) -> str:
    """What is wrong with the sensor that gave a keyframe's record, in words; a sensor that gave none is dead."""
    if record is None or _is_empty(nusc, record):
        return "dead: it gives no data"
    wrong = []
    error = record["timestamp"] - record.get(TRUE_TIMESTAMP, record["timestamp"])
    if abs(error) >= 1000:
        wrong.append(f"its clock is {abs(error) / 1e3:.0f} ms {'ahead' if error > 0 else 'behind'}")
    mount = nusc.get("calibrated_sensor", record["calibrated_sensor_token"])
    if TRUE_TRANSLATION in record:
        shift = np.linalg.norm(np.subtract(record[TRUE_TRANSLATION], mount["translation"]))
        wrong += [f"it sits {shift:.2f} m beside its mount"] * bool(shift > 1e-6)
    if TRUE_ROTATION in record:
        here, there = (
            Rotation.from_quat(each, scalar_first=True) for each in (record[TRUE_ROTATION], mount["rotation"])
        )
        angle = np.degrees((here.inv() * there).magnitude())
        wrong += [f"it is turned by {angle:.2f} degrees"] * bool(angle > 1e-4)
    return "; ".join(wrong) or SOUND


def _is_empty(nusc: NuScenes, record: Record) -> bool:
    """Whether it is the empty sweep that stands for a dead LiDAR, which gives a keyframe its time and pose."""
    path = nusc.path(record)
    return nusc.modalities[nusc.channel(record)] == "lidar" and path.is_file() and path.stat().st_size == 0


def description(scene: Scene) -> str:
    """The scene in Markdown: layout, conditions, and how often each sensor fired."""
    about = scene.record
    seconds = (scene.keyframe_stamps[-1] - scene.keyframe_stamps[0]) * 1e-6
    lines = [
        f"# {about['name']}",
        about.get("description") or about.get("layout") or "",
        f"{len(scene.tokens)} keyframes in {seconds:.1f} s, of `{scene.nusc.root}`.",
    ]
    tables = []
    if condition := about.get("condition"):
        tables.append(["| condition | |", "|---|---|", *(f"| {name} | {_shown(x)} |" for name, x in condition.items())])
    rows = []
    for channel in scene.channels:
        own = scene.of(channel)
        keyframes = sum(reading.keyframe is not None for reading in own)
        rows.append(f"| {channel} | {keyframes} | {len(own) - keyframes} |")
    tables.append(["| sensor | keyframes | sweeps between |", "|---|--:|--:|", *rows])
    return "\n\n".join([*filter(None, lines), *("\n".join(table) for table in tables)])


def _shown(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
