"""A recording as a file that is whole or not there, with the layout that the viewer opens it in."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb

from fusion_net.common.boxes import Boxes
from fusion_net.viz.rerun_log.readings import Scene
from fusion_net.viz.rerun_log.recorder import EGO, TIME, Recorder

APPLICATION = "bev_fusion_lab"


def write_recording(path: Path, scene: Scene, found: Mapping[str, Sequence[Boxes]], *, color: str) -> None:
    """Writes a scene to ``path``. ``found``: what :meth:`Recorder.log_detections` takes, or nothing."""
    part = path.with_name(f"{path.name}.part")
    recording = rr.RecordingStream(APPLICATION)
    try:
        rr.set_strict_mode(True)  # what cannot be logged raises instead of being left out
        recording.save(part, layout(scene.nusc.channels("camera")))
        recording.send_recording_name(scene.record["name"])
        recorder = Recorder(recording, scene, color=color)
        recorder.log_scene()
        if found:
            recorder.log_detections(found)
        recording.flush()
        recording.disconnect()
        part.replace(path)
    finally:
        recording.disconnect()
        part.unlink(missing_ok=True)


def layout(cameras: Sequence[str]) -> rrb.Blueprint:
    """The scene around the car, beside it the cameras with what is projected onto them; below, counts, status and words."""
    around = rrb.Spatial3DView(origin="/".join(EGO), contents="/world/**", name="around the car")
    views = [
        rrb.Spatial2DView(
            origin=rr.new_entity_path([*EGO, camera]), contents=["$origin/**", "/world/labels"], name=camera
        )
        for camera in cameras
    ]
    below = rrb.Tabs(
        rrb.TimeSeriesView(origin="series/boxes", name="boxes"),
        rrb.TimeSeriesView(origin="series/points", name="points"),
        rrb.TextLogView(origin="status", name="status"),
        rrb.TextDocumentView(origin="scene", name="scene"),
    )
    above = rrb.Horizontal(around, rrb.Grid(*views), column_shares=[3, 2]) if views else around
    return rrb.Blueprint(
        rrb.Vertical(above, below, row_shares=[3, 1]),
        rrb.TimePanel(timeline=TIME, state="expanded"),
        rrb.SelectionPanel(state="collapsed"),
    )
