"""Settings of what is beside the road, ``scenario.roadside``: parked vehicles, people, cyclists, work zones, decoys."""

from dataclasses import dataclass

from beartype import beartype

from fusion_net.common.checks import check_names, check_not_negative, check_probabilities, check_ranges

CYCLES = ("bicycle", "motorcycle")
IN_VIEW = ("car", "truck", "bus", "trailer", "construction_vehicle", *reversed(CYCLES))
"""Classes that parked vehicles and cyclists fill up."""


@beartype
@dataclass(frozen=True, kw_only=True)
class Roadside:
    """The actors beside the road. ``configs/scenario/mixed.yaml`` holds the values and docs/scenarios.md a table of them.

    Counts are means per scene in a front camera's view; a rig that looks all round has as many more as it sees more.
    """

    density: float | int  # factor on every count and on work_zone_probability
    in_view: dict[
        str, float
    ]  # objects of a class at a time, traffic included, up to which parked ones and cyclists fill up
    ridden_probability: float | int  # of a bicycle or motorcycle beside the road to be ridden; others are parked
    cycling_speed: dict[str, list[float]]  # by class of CYCLES, [lowest, highest], m/s
    walking: float | int  # people who walk along the road, tries
    walking_speed: list[float]  # [lowest, highest], m/s
    standing: float | int  # people who stand, tries
    crossing: float | int  # people who cross the road, tries
    crossing_speed: list[float]  # [lowest, highest], m/s
    zebra_probability: float | int  # of those who cross to use a zebra crossing, where one is in sight
    work_zone_probability: float | int  # of a scene to have a work zone
    work_zone_length: list[float]  # [lowest, highest], m, without the taper
    metal_plates: float | int  # steel plates on the road, tries
    decoy_probability: float | int  # of a large parked vehicle, a machine or a standing person to be a decoy
    scaled_decoys: float | int  # figures twice a person's size, tries

    def __post_init__(self) -> None:
        counts = ("density", "walking", "standing", "crossing", "metal_plates", "scaled_decoys")
        check_not_negative(**{name: getattr(self, name) for name in counts})
        probabilities = ("ridden_probability", "zebra_probability", "work_zone_probability", "decoy_probability")
        check_probabilities(**{name: getattr(self, name) for name in probabilities})
        check_names("class of in_view", self.in_view, IN_VIEW)
        check_not_negative(**{f"in_view.{name}": count for name, count in self.in_view.items()})
        check_names("class of cycling_speed", self.cycling_speed, CYCLES)
        if missing := [name for name in CYCLES if name not in self.cycling_speed]:
            raise ValueError(f"cycling_speed: the class '{missing[0]}' is missing")
        check_ranges(**{f"cycling_speed.{name}": speed for name, speed in self.cycling_speed.items()})
        ranges = ("walking_speed", "crossing_speed", "work_zone_length")
        check_ranges(**{name: getattr(self, name) for name in ranges})
