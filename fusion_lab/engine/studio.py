"""A handful of scenes for the lab, generated when it is first started, and what their sensors measure in any weather.

The scenes lie on disk as any generated data set does, in clear weather. A file of another weather is rendered when it is first
asked for, from the same episode at the same times, and kept beside them. Labels are those of the clear scene, so that a score
and its change count the same objects.
"""

import copy
import os
import tempfile
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from omegaconf import OmegaConf

from data_gen.generate import Job, generate
from data_gen.jobs.manifest import make_manifest
from data_gen.recording.capture import capture_events
from data_gen.recording.tokens import SceneNames
from data_gen.recording.writer import class_ids, write_data
from data_gen.scene.conditions import Condition, ConditionMix
from data_gen.scene.scene import Scene
from data_gen.sensors.common.event import CaptureEvent
from data_gen.sensors.sense import sense_each
from fusion_lab.engine.ray_memory import RayMemory
from fusion_lab.engine.state import Weather
from fusion_net.common.cli.command import build
from fusion_net.common.cli.composed import composed
from fusion_net.common.cli.config_files import CONFIGS
from fusion_net.common.nuscenes_format import DEPTH_SUFFIX, MANIFEST_FILE
from fusion_net.common.random import stream
from fusion_net.nuscenes.nuscenes import NuScenes
from fusion_net.nuscenes.table_fields import Record

CLEAR = Weather("clear", 1)
RENDERED = "weather"
"""Folder of the files of other weather, below that of the scenes."""
REMEMBERED = 128 * 2**20
"""Bytes of what rays have met that are kept: of a keyframe of the nano rig about 2 MB."""
RENDERERS = 2
"""Threads that render: camera and LiDAR with radar take about as long as each other."""


@dataclass(frozen=True)
class Episode:
    """One scene, built once: what any of its measurements can be rendered from."""

    scene: Scene
    seed: int
    classes: NDArray[np.uint8]  # of class_ids
    events: list[list[CaptureEvent]]  # of each keyframe


class Studio(NuScenes):
    """The scenes of ``job``, generated already, as a data set. :meth:`under` gives the same one in other weather."""

    def __init__(self, job: Job, conditions: ConditionMix) -> None:
        super().__init__(job.data.root)
        self.job, self.conditions = job, conditions
        self.weather: Mapping[str, Weather] = {}
        self._episodes: dict[int, Episode] = {}
        self._memory, self._renderers = RayMemory(REMEMBERED), ThreadPoolExecutor(RENDERERS)
        self.scenes: list[list[str]] = []
        """Sample tokens of each scene, in order of time."""
        for token in self.split("all"):
            if not self.get("sample", token)["prev"]:
                self.scenes.append([])
            self.scenes[-1].append(token)

    @property
    def severities(self) -> dict[str, int]:
        """How many severities each condition has."""
        return {name: len(levels) for name, levels in self.conditions.presets.items()}

    def under(self, weather: Mapping[str, Weather]) -> "Studio":
        """The data set in which the sensors of each modality measure in a weather of their own. Episodes are shared."""
        other = copy.copy(self)
        other.weather = weather
        return other

    def path(self, record: Record) -> Path:
        """File of a sample_data record; rendered if need be."""
        modality = self.modalities[self.channel(record)]
        weather = self.weather.get(modality, CLEAR)
        if not self._notices(modality, weather):
            return super().path(record)
        folder = self.root / RENDERED / f"{weather.name}_{weather.severity}"
        path = folder / record["filename"]
        if not path.is_file():
            self._render(record, weather, folder)
        return path

    def has_exact_depth(self, sample: str) -> bool:
        """Whether exact depth lies beside each image of a sample."""
        images = map(self.path, self._records(sample, "camera"))
        return all(path.with_suffix(DEPTH_SUFFIX).is_file() for path in images)

    def prepare(self, sample: str, modalities: Sequence[str]) -> None:
        """Renders what these modalities lack of a sample, side by side."""
        list(self._renderers.map(lambda name: self._prepare(sample, name), modalities))

    def _prepare(self, sample: str, modality: str) -> None:
        for record in self._records(sample, modality):
            self.path(record)

    def _notices(self, modality: str, weather: Weather) -> bool:
        """Whether a sensor measures something else than in clear weather: light, fog and a wet road are nothing to a radar."""
        levels = self.conditions.presets[weather.name]
        preset = levels[min(weather.severity, len(levels)) - 1]
        is_wet = preset.spray or max(preset.rain_rate) > 0
        return weather.name != CLEAR.name and (modality != "radar" or is_wet)

    def _records(self, sample: str, modality: str) -> list[Record]:
        """Of a sample, those whose sensor is of a modality."""
        records = (r for r in self.sample_data_of[self.scene(sample)["token"]] if r["sample_token"] == sample)
        return [record for record in records if self.modalities[self.channel(record)] == modality]

    def rehearse(self) -> None:
        """Renders the middle keyframe of every scene in every condition once, for nobody: what is compiled, loaded or built for
        the first time takes seconds, and what that is differs: not every scene has a wet truck or a low sun in view."""
        for place, tokens in enumerate(self.scenes):
            episode = self._episode(place)
            for name, severity in self.severities.items():  # the worst has all that the milder ones have
                scene = episode.scene.under(self._condition(Weather(name, severity), episode))
                for _ in sense_each(scene, [_copy(event) for event in episode.events[len(tokens) // 2]]):
                    pass

    def _render(self, record: Record, weather: Weather, folder: Path) -> None:
        """Writes what all sensors of the record's modality measure for its keyframe: radars are cast together anyway."""
        place = next(place for place, tokens in enumerate(self.scenes) if record["sample_token"] in tokens)
        keyframe = self.scenes[place].index(record["sample_token"])
        modality, episode = self.modalities[self.channel(record)], self._episode(place)
        events = [_copy(event) for event in episode.events[keyframe] if event.mount.modality == modality]
        records = self._records(record["sample_token"], modality)
        filenames = {(self.channel(each), each["timestamp"]): each["filename"] for each in records}
        names = SceneNames(self.job.data.name, episode.scene.name, place)
        scene = episode.scene.under(self._condition(weather, episode))
        with tempfile.TemporaryDirectory(dir=self.root) as draft:  # a file is there whole, or not at all
            for event, data in zip(events, sense_each(scene, events), strict=True):
                target = folder / filenames[event.channel, names.stamp(event.time)]
                target.parent.mkdir(parents=True, exist_ok=True)
                write_data(Path(draft) / target.name, modality, data, episode.classes)
                beside = [path for path in Path(draft).iterdir() if path.name != target.name]
                for path in (*beside, Path(draft) / target.name):
                    os.replace(path, target.parent / path.name)

    def _episode(self, place: int) -> Episode:
        """A scene by its place in the data set, built when it is first needed."""
        if place not in self._episodes:
            job, seed = self.job, self.job.scene_seed(place)
            scene = job.scene(place, job.data.splits()[place])
            self._memory.serve(scene)
            events = list(capture_events(job.rig, keyframes=job.data.keyframes, seed=seed))
            self._episodes[place] = Episode(scene, seed, class_ids(scene), events)
        return self._episodes[place]

    def _condition(self, weather: Weather, episode: Episode) -> Condition:
        """What the generator samples for this scene with ``condition=NAME condition.severity=N``."""
        levels = {weather.name: self.conditions.presets[weather.name]}
        mix = ConditionMix(presets=levels, weights={weather.name: 1.0}, severity=weather.severity)
        return mix.sample(stream(episode.seed, "condition"), heading=float(episode.scene.ego.at(0.0)[1]))


def _copy(event: CaptureEvent) -> CaptureEvent:
    """The event with its random stream at the beginning: a stream is read once."""
    return replace(event, rng=copy.deepcopy(event.rng))


def open_studio(folder: Path, *, rig: str, scenes: int, keyframes: int, seed: int) -> Studio:
    """The scenes of a rig below ``folder``, generated if they are not there. Other settings get another folder.

    Raises ValueError for a rig that the generator does not know, OSError when the disk does not take the files.
    """
    known = sorted(path.stem for path in (CONFIGS / "rig").glob("*.yaml"))
    if rig not in known:
        raise ValueError(
            f"the failure lab renders its scenes for the sensors of {' or '.join(known)}; this detector was trained on {rig!r}"
        )
    cfg = composed(
        "data_gen", f"data={rig}", "condition=clear", f"seed={seed}", f"data.num_scenes={scenes}",
        f"data.keyframes={keyframes}",
    )  # fmt: skip
    settings = cast(dict[str, Any], OmegaConf.to_container(cfg, resolve=True))
    data = build(cfg.data, "data")
    data = replace(data, root=str(folder / f"{rig}-{make_manifest(settings)['hash'][:8]}"), split_weights={"val": 1})
    parts = {name: build(cfg[name], name) for name in ("rig", "scenario", "condition")}
    job = Job(data=data, seed=seed, **parts)
    if not (Path(data.root) / MANIFEST_FILE).exists():
        print(f"generating {scenes} scenes for the lab into {data.root}, once", flush=True)
    generate(job, settings=settings, workers=1, command="python -m fusion_lab")
    return Studio(job, build(composed("data_gen").condition, "condition"))
