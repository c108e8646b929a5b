"""From a state to an answer: the keyframe as the broken sensors give it, what the network finds in it, its score."""

from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

from fusion_lab.engine.detectors import Detector, Seen
from fusion_lab.engine.scoring import Score, mean_over_classes, score
from fusion_lab.engine.state import LabState, Offer, first_state
from fusion_lab.engine.studio import Studio
from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.boxes import Boxes
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.data.datamodule import NuScenesDataset, collate
from fusion_net.data.samples import Sample
from fusion_net.evaluation.scoring import GroundTruth
from fusion_net.models.blocks.depth_bins import DepthBins
from fusion_net.runs.trained import Trained

KEPT = 48
"""States whose detections, sensor data and feature maps are kept: all keyframes of a scene, broken and not, at three levels."""


@dataclass(frozen=True)
class Answer:
    """What a state leads to. Frame: ego at the keyframe's time."""

    state: LabState
    sample: Sample
    found: Boxes  # all of them, best first
    seen: Seen
    score: Score
    plain: Score | None  # with nothing wrong; None: not looked at yet
    grid: BEVGrid
    classes: list[str]
    bins: DepthBins | None  # of the camera's depth

    @property
    def shown(self) -> Boxes:
        """The boxes above the threshold."""
        return self.found[self.found.score >= self.state.threshold]


@dataclass(frozen=True)
class Found:
    """What a detector makes of a keyframe."""

    sample: Sample
    found: Boxes
    seen: Seen
    mAP: float  # of the keyframe


class Lab:
    """Answers states, one at a time: not safe for several threads. ``trained``: the detectors to choose from."""

    def __init__(self, studio: Studio, trained: Mapping[str, Trained]) -> None:
        self.studio = studio
        self._detectors = {name: Detector(each) for name, each in trained.items()}
        self._samples = {name: each.samples(studio) for name, each in self._detectors.items()}
        self._beams = min(studio.beams.values(), default=32)
        self._found: OrderedDict[LabState, Found] = OrderedDict()
        self._truth = lru_cache(maxsize=256)(self._ground_truth)

    @property
    def offer(self) -> Offer:
        """What there is to choose from."""
        fewer = [keep for keep in (16, 8, 4) if keep < self._beams]
        frames = min(map(len, self.studio.scenes))
        severities = {"clear": 1} | {k: v for k, v in sorted(self.studio.severities.items()) if k != "clear"}
        layouts = tuple(self.studio.scene(tokens[0])["layout"] for tokens in self.studio.scenes)
        return Offer(tuple(self._detectors), layouts, frames, severities, (self._beams, *fewer))

    def warm_up(self) -> None:
        """Loads, builds and compiles what an answer would wait for: each scene, each condition, each detector."""
        self.studio.rehearse()
        for level in self._detectors:
            self.answer(replace(first_state(self.offer), level=level))

    def no_depth(self, state: LabState) -> dict[str, str]:
        """The choices of ``depth`` that a state cannot have, each with the reason."""
        if not self._detectors[state.level].cameras:
            reason = f"{state.level} fusion paints points and lifts no pixel, so no depth is needed"
            return dict.fromkeys(("uniform", "lidar", "oracle"), reason)
        if not self.studio.has_exact_depth(self.studio.scenes[state.scene][state.frame]):
            return {"oracle": "this data set has no exact depth"}
        return {}

    def answer(self, state: LabState, *, compared: bool = True) -> Answer:
        """The answer to a state. Not ``compared``: without the score of nothing being wrong, if that is not known, which would
        take the network as long again."""
        now, plain = self._seen(state), state.undisturbed.seen_as(self._beams)
        before = self._seen(plain) if compared or plain in self._found else None
        dataset, labels = self._samples[state.level], now.sample.boxes
        return Answer(
            state=state,
            sample=now.sample,
            found=now.found,
            seen=now.seen,
            score=score(now.mAP, labels, now.found, state.threshold),
            plain=None if before is None else score(before.mAP, labels, before.found, state.threshold),
            grid=dataset.grid,
            classes=dataset.classes,
            bins=self._detectors[state.level].bins,
        )

    def look(self, state: LabState) -> None:
        """Lets the detector see a state, so that what is asked of it later is known."""
        self._seen(state)

    def prepare(self, state: LabState, modality: str) -> None:
        """Renders what a sensor measures in a state, so that an answer finds it. Shorter than an answer: nobody waits long."""
        self._studio_of(state).prepare(self.studio.scenes[state.scene][state.frame], [modality])

    def scene_score(self, state: LabState) -> tuple[float, float]:
        """mAP over all keyframes of the scene and the classes that it has labels of, and the same with nothing wrong."""
        truth = self._truth(state.level, state.scene, None)
        frames = range(self.offer.frames)
        now, before = (
            mean_over_classes(truth, [self._seen(replace(each, frame=frame)).found for frame in frames])
            for each in (state, state.undisturbed)
        )
        return now, before

    def _seen(self, state: LabState) -> Found:
        """What the detector finds in a state, which of the last KEPT states is known."""
        key = state.seen_as(self._beams)
        if key not in self._found:
            self._found[key] = self._find(key)
        self._found.move_to_end(key)
        while len(self._found) > KEPT:
            self._found.popitem(last=False)
        return self._found[key]

    def _find(self, state: LabState) -> Found:
        sample = self._read(state)
        found, seen = self._detectors[state.level].run(collate([sample]), state.depth)
        truth = self._truth(state.level, state.scene, state.frame)
        return Found(sample, found, seen, mean_over_classes(truth, [found]))

    def _read(self, state: LabState) -> Sample:
        dataset = self._samples[state.level]
        token = self.studio.scenes[state.scene][state.frame]
        reader = replace(dataset.reader, faults=state.faults(self._beams))
        nusc = self._studio_of(state)
        nusc.prepare(token, [name for name in MODALITIES if state.is_current(name)])
        sample = reader.read(nusc, token)
        return replace(sample, boxes=sample.boxes[dataset.grid.contains(sample.boxes.center)])

    def _studio_of(self, state: LabState) -> Studio:
        """The data set in the weather that each sensor measures in."""
        return self.studio.under({name: state.weather(name) for name in MODALITIES})

    def _ground_truth(self, level: str, scene: int, frame: int | None) -> GroundTruth:
        """Of one keyframe, or of all keyframes of a scene that every scene has."""
        dataset: NuScenesDataset = self._samples[level]
        tokens = self.studio.scenes[scene][: self.offer.frames]
        chosen = tokens if frame is None else [tokens[frame]]
        return GroundTruth([(self.studio, token) for token in chosen], classes=dataset.classes, grid=dataset.grid)
