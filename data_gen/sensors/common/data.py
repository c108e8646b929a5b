"""What sensors deliver, as the recording handles it: which points and rays there are, and what faults leave of them."""

from dataclasses import fields, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from data_gen.sensors.common.event import CaptureEvent
from fusion_net.common.fault_effects import Rings


class SensorData:
    """The data of one capture event. These defaults are those of data without points and without rays."""

    @property
    def points_in_sensor_frame(self) -> NDArray[np.float32]:
        """(P, 3) in metres, as they are written."""
        return np.zeros((0, 3), np.float32)

    @property
    def point_bodies(self) -> NDArray[np.int32]:
        """(P,) what caused each point: actor index, or WORLD or NOTHING, which are negative."""
        return np.zeros(0, np.int32)

    @property
    def ray_counts(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Per actor (A,), how many rays would meet it alone and how many do, as in ``scene.Hits``; 0 where none are counted."""
        return np.zeros((), np.int64), np.zeros((), np.int64)

    def with_faults(self, event: CaptureEvent[Any], stamp: int) -> Self:
        """What the event's faults leave. ``stamp`` is the reported time in us."""
        raise NotImplementedError


class PointData(SensorData):
    """A dataclass of points, one column per field but for those in ``per_actor``."""

    per_actor: ClassVar[tuple[str, ...]] = ()
    body: NDArray[np.int32]

    @property
    def point_bodies(self) -> NDArray[np.int32]:
        """``body``."""
        return self.body

    def rings(self, mount: Any) -> Rings | None:
        """Which beam measured each point; None of a sensor without beams."""
        return None

    def select(self, keep: NDArray[np.bool_]) -> Self:
        """The points of a mask (P,)."""
        names = [field.name for field in fields(self) if field.name not in self.per_actor]  # type: ignore[arg-type]
        return replace(self, **{name: getattr(self, name)[keep] for name in names})  # type: ignore[type-var]

    def with_faults(self, event: CaptureEvent[Any], stamp: int) -> Self:
        """Fewer points."""
        if not event.faults:
            return self
        reported = event.mount.ego_T_sensor
        return self.select(event.faults.kept(self.points_in_sensor_frame, reported, stamp, self.rings(event.mount)))
