"""Records one scene: its sensors capture, a writer takes what they measured."""

from pathlib import Path

from data_gen.recording.annotations import Row
from data_gen.recording.capture import capture
from data_gen.recording.faults import SceneFaults
from data_gen.recording.schedule import keyframe_times
from data_gen.recording.tokens import SceneNames
from data_gen.recording.writer import SceneWriter
from data_gen.rig.rig import Rig
from data_gen.scene.scene import Scene
from fusion_net.common.faults import FaultPlan


def record_scene(
    scene: Scene,
    rig: Rig,
    *,
    root: Path,
    dataset: str,
    index: int,
    keyframes: int,
    seed: int,
    layout: str,
    faults: FaultPlan | None = None,
) -> dict[str, list[Row]]:
    """Writes the files of a scene and returns its rows by table name. Raises OSError when the disk does not take them."""
    names = SceneNames(dataset, scene.name, index)
    times = keyframe_times(rig, keyframes, seed=seed)
    active = SceneFaults(faults or FaultPlan(), rig.modalities, names.scene_token, names.sample_tokens(keyframes))
    writer = SceneWriter(scene, rig, names, times=times, root=root, layout=layout)
    for event, data in capture(scene, rig, keyframes=keyframes, seed=seed, faults=active):
        writer.add(event, data)
    return writer.finish()
