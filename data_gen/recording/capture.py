"""Lets every sensor of a rig measure throughout an episode, in the order in which it is written, without touching files."""

from collections.abc import Iterator

from data_gen.recording.faults import SceneFaults
from data_gen.recording.schedule import event_time, events_due, keyframe_time
from data_gen.rig.rig import Rig
from data_gen.scene.scene import Scene
from data_gen.sensors.common.data import SensorData
from data_gen.sensors.common.event import CaptureEvent
from data_gen.sensors.sense import sense_each
from fusion_net.common.faults import SensorFaults
from fusion_net.common.random import stream


def capture(
    scene: Scene, rig: Rig, *, keyframes: int, seed: int, faults: SceneFaults | None = None
) -> Iterator[tuple[CaptureEvent, SensorData]]:
    """Every event that is written to disk with what its sensor measured, by keyframe and channel, oldest first within a
    channel. The data are those of a sensor whose faults only change when and from where it measures.

    Of a dead sensor only keyframes come: what it would have measured there is what is labelled.
    """
    for events in capture_events(rig, keyframes=keyframes, seed=seed, faults=faults):
        yield from zip(events, sense_each(scene, events), strict=True)


def capture_events(
    rig: Rig, *, keyframes: int, seed: int, faults: SceneFaults | None = None
) -> Iterator[list[CaptureEvent]]:
    """The events of each keyframe, in the order of :func:`capture`."""
    start = keyframe_time(rig, 0, seed=seed)
    for index, due in enumerate(events_due(rig, keyframes, seed=seed)):
        events = []
        for channel, numbers in due.items():
            active = faults.on(channel, index) if faults else SensorFaults()
            for number in numbers[-1:] if active.dead else numbers:
                events.append(_event(rig, channel, number, seed, start, active, index, number == numbers[-1]))
        yield events


def _event(
    rig: Rig, channel: str, number: int, seed: int, start: float, faults: SensorFaults, keyframe: int, is_keyframe: bool
) -> CaptureEvent:
    """The ``number``-th measurement of a channel; ``start`` is the time of the first keyframe. Stale data are those of an
    earlier measurement to the last bit, so its time names the random stream."""
    mount = rig.sensors[channel]
    measured = event_time(mount, number - faults.late_firings, channel=channel, seed=seed)
    return CaptureEvent(
        mount=mount,
        time=event_time(mount, number, channel=channel, seed=seed),
        true_time=measured - faults.clock_error(measured - start),
        ego_T_sensor=faults.true_mount(mount.ego_T_sensor),
        rng=stream(seed, channel, round(measured * 1e6)),
        lens_seed=int(stream(seed, channel, "lens").integers(2**62)),
        faults=faults,
        channel=channel,
        keyframe=keyframe,
        is_keyframe=is_keyframe,
    )
