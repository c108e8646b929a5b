"""One measurement of what a detector does under a fault: which fault, how much of it, which sensors it is asked with."""

from dataclasses import dataclass

from fusion_net.common.faults import Fault
from fusion_net.evaluation.cells.delays import Delay
from fusion_net.evaluation.drop_table import SUBSETS

ALL_SENSORS = SUBSETS[:1]


@dataclass(frozen=True, kw_only=True)
class Cell:
    """A cell by its ``name``, which is unlike any other's in its ``group``; a group is kept in one file.

    Cells of one ``curve`` differ in ``amount`` alone (degrees, metres, seconds or a severity). What ``faults`` take is known to
    be gone unless the cell is ``silent``: then the sensor is said to be there, with a black image or no points. ``parts``:
    also scored by these groupings of the labels (``measure.GROUPINGS``). ``every_scene``: not on the thinned scenes.
    ``root``: another folder of data than the run's own.
    """

    group: str
    name: str
    curve: str = ""
    amount: float = 0.0
    faults: tuple[Fault, ...] = ()
    silent: bool = False
    delay: Delay | None = None
    subsets: tuple[tuple[str, ...], ...] = ALL_SENSORS
    parts: tuple[str, ...] = ()
    every_scene: bool = False
    root: str | None = None

    @property
    def sensors(self) -> set[str]:
        """The modalities or channels that something happens to."""
        return {sensor for fault in self.faults for sensor in fault.sensors} | (
            {self.delay.sensor} if self.delay else set()
        )
