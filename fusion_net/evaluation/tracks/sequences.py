"""Tracks over whole scenes, keyframe after keyframe: of the boxes of one detector, and of the tracks of several."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from fusion_net.common.boxes import Boxes
from fusion_net.evaluation.tracks.measurements import Measurements
from fusion_net.evaluation.tracks.track_fusion import FusedTracks, TrackFusion
from fusion_net.evaluation.tracks.tracker import Tracker
from fusion_net.evaluation.tracks.tracks import Tracks
from fusion_net.metrics.track_paths import Frames
from fusion_net.models.late.estimates import Estimates


def track_scenes(
    found: Sequence[Boxes | Estimates],
    sensors: Sequence[str],
    *,
    frames: Frames,
    global_T_ego: NDArray[np.float64],
    tracker: Tracker,
    measurements: Measurements,
) -> list[Tracks]:
    """The tracks that live at each of S samples, GLOBAL frame. ``found``: what each sample shows, in the ego frame, found with
    these sensors; ``global_T_ego`` (S, 4, 4). Which of the tracks are reported says ``tracker.shown``."""
    lived: list[Tracks] = [Tracks.empty()] * len(found)
    for samples in scenes_in_time(frames):
        tracks, next_number, time = Tracks.empty(), 0, frames.timestamp[samples[0]]
        for sample in samples.tolist():
            seen = measurements(found[sample], global_T_ego[sample], sensors)
            seconds = 1e-6 * float(frames.timestamp[sample] - time)
            tracks = tracker.step(tracks, seen, seconds=seconds, next_number=next_number)
            next_number = max(next_number, int(tracks.number.max(initial=-1)) + 1)
            lived[sample], time = tracks, frames.timestamp[sample]
    return lived


def fuse_scenes(sensors: Mapping[str, Sequence[Tracks]], *, frames: Frames, fusion: TrackFusion) -> list[Tracks]:
    """The tracks of each of S samples by sensor (:func:`track_scenes`), as one list each."""
    fused: list[Tracks] = [Tracks.empty()] * len(frames.scene)
    for samples in scenes_in_time(frames):
        state, next_number = FusedTracks.empty(), 0
        for sample in samples.tolist():
            now = {name: tracks[sample] for name, tracks in sensors.items()}
            state = fusion(state, now, next_number=next_number)
            next_number = max(next_number, int(state.tracks.number.max(initial=-1)) + 1)
            fused[sample] = state.tracks
    return fused


def scenes_in_time(frames: Frames) -> Iterator[NDArray[np.int64]]:
    """The samples of each scene in the order of time."""
    order = np.argsort(frames.rank)
    return iter(np.split(order, np.flatnonzero(np.diff(frames.scene[order])) + 1) if len(order) else [])
