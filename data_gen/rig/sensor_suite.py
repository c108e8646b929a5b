"""All sensors of a car, whether a car could have them or not: ``rig.Rig`` is one that has been checked."""

from dataclasses import dataclass, field

from beartype import beartype

from data_gen.rig.mounts import Camera, Lidar, Mount, Radar

ALL = "all"
"""In the place of a number of sweeps: every firing since the keyframe before."""


@beartype
@dataclass(frozen=True, kw_only=True)
class SensorSuite:
    """All sensors by nuScenes channel name. ``keyframe_rate`` Hz; ``sweeps`` by modality how many firings before each
    keyframe's are written (0, if not named: none), or ``all`` since the keyframe before."""

    name: str
    cameras: dict[str, Camera]
    lidars: dict[str, Lidar]
    radars: dict[str, Radar]
    keyframe_rate: float = 2.0
    sweeps: dict[str, int | str] = field(default_factory=dict)

    @property
    def sensors(self) -> dict[str, Mount]:
        """Every mount by channel: cameras, then LiDARs, then radars."""
        return {**self.cameras, **self.lidars, **self.radars}

    @property
    def modalities(self) -> dict[str, str]:
        """The modality of every channel."""
        return {channel: mount.modality for channel, mount in self.sensors.items()}

    def past_events(self, channel: str) -> int | str:
        """The modality's number in ``sweeps``, or ALL."""
        return self.sweeps.get(self.modalities[channel], 0)
