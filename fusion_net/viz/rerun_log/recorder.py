"""A scene in Rerun's terms: the tree of entities is the tree of frames.

``world`` is the global frame, ``world/ego`` the car, ``world/ego/CHANNEL`` a sensor, and what it measured lies below it, in
its own axes. Timelines: ``time``, seconds since the scene's first reading, of each sensor by its own clock; ``keyframe``, whole
numbers, at which everything is where the reader has it at the keyframe's reference time.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fusion_net.common.boxes import Boxes
from fusion_net.common.drawing import CLASS_COLORS
from fusion_net.common.geometry import invert
from fusion_net.common.nuscenes_format import CLASSES
from fusion_net.nuscenes.sensor_files import read_lidar, read_radar
from fusion_net.viz.rerun_log.ground import ground
from fusion_net.viz.rerun_log.readings import Array, Reading, Scene, Stamps, held
from fusion_net.viz.rerun_log.shapes import RADAR, arrows_of, boxes_3d, lidar_colors, values
from fusion_net.viz.rerun_log.status import changes, description

TIME, KEYFRAME = "time", "keyframe"
EGO = ("world", "ego")
CONTENT = {"camera": ("image",), "lidar": ("points",), "radar": ("points", "velocity")}
"""What lies below a sensor of each modality."""
DOT, IMAGE_PLANE = 1.5, 3.0
"""Pixels of a point; metres from a camera to its picture in the 3-D view."""


class Recorder:
    """Logs one scene to a recording; LiDAR points are coloured by ``color``, "intensity" or "height"."""

    def __init__(self, recording: rr.RecordingStream, scene: Scene, *, color: str) -> None:
        self.recording, self.scene, self.color = recording, scene, color
        self._start = int(scene.path[0][0])
        self._log_reading = {"camera": self._log_image, "lidar": self._log_lidar, "radar": self._log_radar}
        recording.set_log_time_enabled(False)
        recording.set_log_tick_enabled(False)

    def log_scene(self) -> None:
        """Everything but detections."""
        scene = self.scene
        self._log_fixed()
        self._send_poses(EGO, *scene.path, dict(enumerate(scene.keyframe_poses)))
        for channel in scene.channels:
            self._log_sensor(channel, scene.of(channel))
        self._log_labels()
        for change in changes(scene):
            self._at_keyframe(change.keyframe)
            level = rr.TextLogLevel.WARN if change.is_fault else rr.TextLogLevel.INFO
            self._log("status", change.channel, what=rr.TextLog(f"{change.channel}: {change.state}", level=level))

    def log_detections(self, found: Mapping[str, Sequence[Boxes]]) -> None:
        """Boxes of each keyframe in its reference ego frame, by the sensors that they were found with (C+L+R). Their labels
        index CLASSES."""
        scene = self.scene
        here = (*EGO, "detections")
        self._send_held(here, scene.keyframe_stamps, scene.keyframe_poses, dict(enumerate(scene.keyframe_poses)))
        for subset, of_keyframes in found.items():
            for number, boxes in enumerate(of_keyframes):
                self._at_keyframe(number)
                names = [f"{CLASSES[k]} {score:.2f}" for k, score in zip(boxes.label, boxes.score, strict=True)]
                shape = boxes_3d(boxes, names, fill_mode=rr.components.FillMode.TransparentFillMajorWireframe)
                self._log(*here, subset, what=[shape, values(score=boxes.score)])
                self._log(*here, subset, "velocity", what=arrows_of(boxes))
                self._log("series", "boxes", subset, what=rr.Scalars(len(boxes)))

    def _log_fixed(self) -> None:
        """What holds throughout: names and colours of the classes, axes, the map, the scene in words."""
        classes = zip(CLASSES, CLASS_COLORS, strict=True)
        names = rr.AnnotationContext([rr.AnnotationInfo(k, name, color) for k, (name, color) in enumerate(classes)])
        self._log("world", what=[rr.ViewCoordinates.RIGHT_HAND_Z_UP, names], static=True)
        self._log(*EGO, what=rr.TransformAxes3D(2.0), static=True)
        words = rr.TextDocument(description(self.scene), media_type="text/markdown")
        self._log("scene", what=words, static=True)
        plane = ground(self.scene)
        if plane is not None:
            mesh = rr.Mesh3D(
                vertex_positions=plane.corners,
                triangle_indices=[[0, 1, 2], [0, 2, 3]],
                vertex_texcoords=[[0, 1], [1, 1], [1, 0], [0, 0]],
                albedo_texture=plane.image,
            )
            self._log("world", "map", what=mesh, static=True)

    def _log_sensor(self, channel: str, readings: Sequence[Reading]) -> None:
        """A sensor's frame and what it measured. Where a keyframe has nothing of it, what was there before is cleared."""
        if not readings:
            return
        stamps = np.array([reading.stamp for reading in readings], np.int64)
        places = np.array([reading.global_T_sensor for reading in readings])
        of_keyframes = {each.keyframe: each.global_T_sensor for each in readings if each.keyframe is not None}
        self._send_held((*EGO, channel), stamps, places, of_keyframes)
        for reading in readings:
            self._at(reading.stamp, reading.keyframe)
            self._log_reading[reading.modality](reading)
        for number in self.scene.silent(channel):
            self._at_keyframe(number)
            for part in CONTENT[readings[0].modality]:
                self._log(*EGO, channel, part, what=rr.Clear(recursive=False))
            if "points" in CONTENT[readings[0].modality]:
                self._log("series", "points", channel, what=rr.Scalars(0))

    def _log_image(self, reading: Reading) -> None:
        nusc = self.scene.nusc
        height, width = nusc.image_size(reading.record)
        with nusc.file_of(reading.record) as path:
            image = rr.EncodedImage(path=path)
        pinhole = rr.Pinhole(
            image_from_camera=nusc.cam_K(reading.record),
            resolution=[width, height],
            camera_xyz=rr.ViewCoordinates.RDF,
            image_plane_distance=IMAGE_PLANE,
        )
        self._log(*EGO, reading.channel, what=pinhole)
        self._log(*EGO, reading.channel, "image", what=image)

    def _log_lidar(self, reading: Reading) -> None:
        with self.scene.nusc.file_of(reading.record) as path:
            points, _ = read_lidar(path)
        points = points[np.isfinite(points[:, :4]).all(axis=1)]
        self._log_points(reading.channel, points[:, :3], lidar_colors(points, reading.ego_T_sensor, by=self.color))

    def _log_radar(self, reading: Reading) -> None:
        with self.scene.nusc.file_of(reading.record) as path:
            seen = read_radar(path)
        place = np.stack([seen["x"], seen["y"], seen["z"]], axis=1)
        velocity = np.stack([seen["vx_comp"], seen["vy_comp"], np.zeros(len(seen))], axis=1)
        self._log_points(reading.channel, place, RADAR)
        arrows = rr.Arrows3D(origins=place, vectors=velocity, colors=RADAR)
        self._log(*EGO, reading.channel, "velocity", what=arrows)

    def _log_points(self, channel: str, points: NDArray, colors: Any) -> None:
        cloud = rr.Points3D(points, colors=colors, radii=rr.Radius.ui_points(DOT))
        self._log(*EGO, channel, "points", what=cloud)
        self._log("series", "points", channel, what=rr.Scalars(len(points)))

    def _log_labels(self) -> None:
        """The labelled boxes in the global frame; an object keeps its number through the scene."""
        numbers: dict[str, int] = {}
        for keyframe, token in enumerate(self.scene.tokens):
            labels = self.scene.nusc.annotations(token, CLASSES)
            own = [numbers.setdefault(instance, len(numbers)) for instance in labels.instance.tolist()]
            names = [f"{CLASSES[k]} {number}" for k, number in zip(labels.boxes.label, own, strict=True)]
            more = values(
                instance=labels.instance,
                attribute=labels.attribute,
                visibility=labels.visibility,
                num_lidar_pts=labels.num_lidar_pts,
                num_radar_pts=labels.num_radar_pts,
            )
            self._at_keyframe(keyframe)
            self._log("world", "labels", what=[boxes_3d(labels.boxes, names), more])
            self._log("world", "labels", "velocity", what=arrows_of(labels.boxes))
            self._log("series", "boxes", "labels", what=rr.Scalars(len(labels)))

    def _send_held(
        self, entity: Sequence[str], stamps: Stamps, places: Array, of_keyframes: Mapping[int, Array]
    ) -> None:
        """Poses in the ego frame of what was at ``places`` (N, 4, 4) of the global frame at its own times (N,), and at those of
        keyframes."""
        numbers = list(of_keyframes)
        there = np.array(list(of_keyframes.values())).reshape(-1, 4, 4)
        at_keyframes = invert(self.scene.keyframe_poses[numbers]) @ there
        times, poses = held(*self.scene.path, stamps, places)
        self._send_poses(entity, times, poses, dict(zip(numbers, at_keyframes, strict=True)))

    def _send_poses(
        self, entity: Sequence[str], stamps: Stamps, poses: Array, of_keyframes: Mapping[int, Array]
    ) -> None:
        """``parent_T_entity`` at times (T,), and at keyframes."""
        timed = rr.TimeColumn(TIME, duration=(stamps - self._start).astype("timedelta64[us]"))
        numbered = rr.TimeColumn(KEYFRAME, sequence=list(of_keyframes))
        for index, matrices in ((timed, poses), (numbered, np.array(list(of_keyframes.values())))):
            if len(matrices):
                columns = rr.Transform3D.columns(
                    translation=matrices[:, :3, 3], quaternion=Rotation.from_matrix(matrices[:, :3, :3]).as_quat()
                )
                self.recording.send_columns(rr.new_entity_path([*entity]), indexes=[index], columns=columns)

    def _at(self, stamp: int, keyframe: int | None) -> None:
        """What is logged next is of this time, and of this keyframe if it is of one."""
        self.recording.reset_time()
        self.recording.set_time(TIME, duration=np.timedelta64(stamp - self._start, "us"))
        if keyframe is not None:
            self.recording.set_time(KEYFRAME, sequence=keyframe)

    def _at_keyframe(self, number: int) -> None:
        self._at(int(self.scene.keyframe_stamps[number]), number)

    def _log(self, *entity: str, what, static: bool = False) -> None:
        first, *more = what if isinstance(what, list) else [what]
        self.recording.log([*entity], first, *more, static=static)
