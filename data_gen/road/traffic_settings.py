"""Settings of the simulated traffic, ``scenario.traffic``: how many vehicles, how fast, in which bodies."""

from dataclasses import dataclass

from beartype import beartype

from fusion_net.common.checks import check_names, check_not_negative, check_probabilities, check_ranges, check_weights

DRIVEN = ("car", "truck", "bus", "motorcycle", "construction_vehicle")
"""Classes of the simulated vehicles, in the order in which they are sampled."""


@beartype
@dataclass(frozen=True, kw_only=True)
class Traffic:
    """The vehicles on the lanes. ``configs/scenario/mixed.yaml`` holds the values and docs/scenarios.md a table of them."""

    density: float | int  # factor on the number of vehicles
    speed: dict[str, list[float]]  # by layout, [lowest, highest] desired speed of a scene, m/s
    ego_speed_factor: list[float]  # [lowest, highest] factor of the ego's own desired speed on the scene's
    speed_factor: list[float]  # the same of every other vehicle
    waiting_probability: float | int  # of a scene in which the ego stands all or part of the time
    queue_probability: float | int  # of a scene in which the vehicles ahead stand or creep in a queue
    class_mix: dict[str, float]  # relative weights of the DRIVEN classes
    trailer_probability: float | int  # of a truck to tow a trailer, where there is room
    max_construction_speed: float | int  # m/s; a faster construction vehicle becomes a truck

    def __post_init__(self) -> None:
        check_not_negative(density=self.density, max_construction_speed=self.max_construction_speed)
        check_probabilities(
            waiting_probability=self.waiting_probability,
            queue_probability=self.queue_probability,
            trailer_probability=self.trailer_probability,
        )
        check_ranges(ego_speed_factor=self.ego_speed_factor, speed_factor=self.speed_factor)
        check_ranges(**{f"speed.{name}": pace for name, pace in self.speed.items()})
        check_names("class of class_mix", self.class_mix, DRIVEN)
        check_weights("class_mix", self.class_mix)

    def class_probabilities(self) -> list[float]:
        """Of the DRIVEN classes, in their order."""
        weights = [self.class_mix.get(name, 0.0) for name in DRIVEN]
        return [weight / sum(weights) for weight in weights]
