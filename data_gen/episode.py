"""One episode: a layout, its traffic, its scenery and its weather, put together as a :class:`Scene`."""

from dataclasses import dataclass, field

from beartype import beartype

from data_gen.actors.traffic import populate
from data_gen.rig.coverage import FRONT, Sector
from data_gen.road.layout import LAYOUTS, record_layout
from data_gen.scene.conditions import ConditionMix
from data_gen.scene.scene import Scene
from data_gen.world.scenery import build_world
from fusion_net.common.random import stream


@beartype
@dataclass(frozen=True)
class Scenario:
    """Which layouts a split draws, by relative weight. A split without an entry uses ``train``'s."""

    layouts: dict[str, dict[str, float | int]] = field(default_factory=lambda: {"train": dict.fromkeys(LAYOUTS, 1.0)})

    def __post_init__(self) -> None:
        for split, weights in self.layouts.items():
            unknown = sorted(set(weights) - set(LAYOUTS))
            if unknown:
                raise ValueError(
                    f"scenario.layouts.{split}: unknown layout '{unknown[0]}'; there are {', '.join(LAYOUTS)}"
                )
            if not any(weight > 0 for weight in weights.values()):
                raise ValueError(f"scenario.layouts.{split}: no layout has a weight above 0")

    def draw(self, split: str, *, seed: int) -> str:
        """The layout of the episode with this seed."""
        weights = self.layouts.get(split, self.layouts["train"])
        names = sorted(weights)
        share = [weights[name] for name in names]
        total = sum(share)
        return str(stream(seed, "layout").choice(names, p=[weight / total for weight in share]))


def build_episode(
    *, name: str, layout: str, seed: int, duration: float, condition: ConditionMix, view: Sector = FRONT
) -> Scene:
    """The scene called ``name`` on a named layout: all else follows from ``seed``. ``duration`` in seconds; ``view`` is where
    the rig looks: it is filled as densely as a front camera's."""
    recorded = record_layout(layout, seed=seed, duration=duration)
    weather = condition.sample(stream(seed, "condition"), heading=float(recorded.ego.at(0.0)[1]))
    world = build_world(recorded, seed=seed)
    return Scene(
        name=name,
        ego=recorded.ego,
        actors=populate(recorded, seed=seed, density=view.half / FRONT.half, view=view, lorry_ahead=weather.spray),
        world=world.mesh,
        ground_faces=world.ground_faces,
        ground=world.ground,
        world_scatterers=world.scatterers,
        condition=weather,
    )
