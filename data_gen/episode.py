"""One episode: a layout, its traffic, its scenery and its weather, put together as a :class:`Scene`."""

from dataclasses import dataclass, field

from beartype import beartype

from data_gen.actors.roadside_settings import Roadside
from data_gen.actors.traffic import populate
from data_gen.rig.coverage import FRONT, Sector
from data_gen.road.layout import record_layout
from data_gen.road.streets import STREETS, Street
from data_gen.road.traffic_settings import Traffic
from data_gen.scene.conditions import ConditionMix
from data_gen.scene.scene import Scene
from data_gen.world.scenery import build_world
from fusion_net.common.checks import check_names, check_weights
from fusion_net.common.random import stream


@beartype
@dataclass(frozen=True, kw_only=True)
class Scenario:
    """What happens in the scenes of a data set, all but weather and light.

    ``layouts``: by split, relative weights of the layouts; a split without an entry uses ``train``'s. ``streets``: layouts of
    one's own, beside the eight.
    """

    layouts: dict[str, dict[str, float | int]]
    traffic: Traffic
    roadside: Roadside
    streets: dict[str, Street] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if "train" not in self.layouts:
            raise ValueError("layouts: the split 'train' is missing, whose weights every other split falls back on")
        known = tuple(self.all_streets)
        check_names("layout of traffic.speed", self.traffic.speed, known)
        for split, weights in self.layouts.items():
            check_names(f"layout of layouts.{split}", weights, known)
            check_weights(f"layouts.{split}", weights)
            if missing := [name for name in weights if name not in self.traffic.speed]:
                raise ValueError(f"traffic.speed: the layout '{missing[0]}' is missing")

    @property
    def all_streets(self) -> dict[str, Street]:
        """The streets of every layout that there is, by its name."""
        return STREETS | self.streets

    def sample_layout(self, split: str, *, seed: int) -> str:
        """The layout of the episode with this seed."""
        weights = self.layouts.get(split, self.layouts["train"])
        names = sorted(weights)
        total = sum(weights[name] for name in names)
        return str(stream(seed, "layout").choice(names, p=[weights[name] / total for name in names]))


def build_episode(
    *,
    name: str,
    layout: str,
    seed: int,
    duration: float,
    scenario: Scenario,
    condition: ConditionMix,
    view: Sector = FRONT,
) -> Scene:
    """The scene called ``name`` on a named layout: all else follows from ``seed``. ``duration`` in seconds; ``view`` is where
    the rig looks: it is filled as densely as a front camera's."""
    street = scenario.all_streets.get(layout)
    recorded = record_layout(layout, seed=seed, duration=duration, traffic=scenario.traffic, street=street)
    weather = condition.sample(stream(seed, "condition"), heading=float(recorded.ego.at(0.0)[1]))
    world = build_world(recorded, seed=seed)
    return Scene(
        name=name,
        ego=recorded.ego,
        actors=populate(
            recorded,
            seed=seed,
            traffic=scenario.traffic,
            roadside=scenario.roadside,
            view=view,
            truck_ahead=weather.spray,
        ),
        world=world.mesh,
        ground_faces=world.ground_faces,
        ground=world.ground,
        world_scatterers=world.scatterers,
        condition=weather,
    )
