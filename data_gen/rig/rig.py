"""A rig: sensors that a car can have, and how long an episode it needs."""

from dataclasses import dataclass

from beartype import beartype

from data_gen.rig.rig_checks import EPISODE_LEAD, check_rig
from data_gen.rig.sensor_suite import SensorSuite


@beartype
@dataclass(frozen=True, kw_only=True)
class Rig(SensorSuite):
    """A sensor suite without what no car could have. Raises ValueError for the first thing that cannot be."""

    def __post_init__(self) -> None:
        check_rig(self)

    def duration(self, keyframes: int) -> float:
        """Seconds of an episode with so many keyframes, the lead for the sweeps before the first included."""
        return EPISODE_LEAD + keyframes / self.keyframe_rate
