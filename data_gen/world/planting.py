"""What grows and stands in rows along the verges: trees, lamps, signs, rails."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from data_gen.assets.catalogue import VARIANT_NAMES, build_asset
from data_gen.world.props import Props
from data_gen.world.roadside import Verge
from data_gen.world.site import Site

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Planting:
    """A kind of prop along the verges: every ``spacing`` metres, ``setback`` metres off the road (a range), each with
    probability ``share``; it needs ``room`` metres free of road around it and wanders by ``jitter`` metres (1 sigma)."""

    kind: str
    spacing: float
    setback: tuple[float, float]
    share: float = 1.0
    room: float = 0.4
    jitter: float = 0.0
    only: tuple[str, ...] = ()  # names of variants; all if empty


# Setbacks count from the carriageway's edge: on urban roads the kerb's face, then 2.5 m of pavement; elsewhere the outer
# edge of the hard shoulder. The middle of the pavement (1.25 m) stays free for those who walk.
URBAN_PLANTS = (
    Planting("street_lamp", 27.0, (0.55, 0.6)),
    Planting("sign_post", 21.0, (0.5, 0.6), 0.5),
    Planting("pole", 34.0, (2.3, 2.4), 0.4),
    Planting("bench", 31.0, (2.1, 2.2), 0.3, 1.5),
    Planting("tree", 11.0, (5.5, 7.0), 0.5, 4.5, 0.3),
    Planting("bush", 6.0, (3.7, 4.9), 0.35, 3.2, 0.2, ("round", "hedge", "tall")),
    Planting("billboard", 70.0, (6.0, 9.0), 0.5, 5.0),
    Planting("grove", 15.0, (28.0, 46.0), 0.55, 22.0, 3.0),
)
RURAL_PLANTS = (
    Planting("guard_rail", 4.0, (0.6, 0.6), room=0.3),
    Planting("street_lamp", 38.0, (1.3, 1.4), 0.35, 0.8),
    Planting("sign_post", 42.0, (1.4, 2.2), 0.6, 1.0),
    Planting("pole", 48.0, (5.0, 6.5), 0.4, 3.0),
    Planting("bush", 3.0, (1.4, 4.0), 0.5, 1.2, 0.5, ("grass", "straw")),
    Planting("bush", 7.0, (4.0, 11.0), 0.5, 3.0, 1.0, ("round", "hedge", "tall")),
    Planting("tree", 8.0, (8.0, 18.0), 0.5, 6.0, 1.5),
    Planting("billboard", 80.0, (9.0, 16.0), 0.5, 6.0),
    Planting("grove", 16.0, (34.0, 60.0), 0.6, 26.0, 4.0),
)
_BUDGET = {"tree": 8000, "bush": 2800, "grove": 4500, "guard_rail": 7000}
"""The most triangles of a planting of that kind, nearest to the ego's path first."""
_MIXED = ("tree", "bush", "sign_post", "pole", "grove", "billboard")
"""Kinds of which every piece may be another model; of lamps and rails there is one a road."""


def plant(
    planting: Planting, share: float, verges: list[Verge], site: Site, props: Props, rng: np.random.Generator
) -> None:
    """Set out a row of props along each verge, where the site has room, within the budget of triangles."""
    kind = planting.kind
    rows = [verge.places(planting.spacing, rng) for verge in verges]
    at, outward = (np.concatenate(part) for part in zip(*rows, strict=True)) if rows else (np.zeros((0, 2)),) * 2
    at = at + rng.uniform(*planting.setback, (len(at), 1)) * outward + rng.normal(0.0, 1.0, at.shape) * planting.jitter
    kept = np.flatnonzero((rng.random(len(at)) < share) & (site.room_at(at) >= planting.room))
    kept = kept[np.argsort(cKDTree(site.path).query(at[kept])[0], kind="stable")]
    at, outward = at[kept], outward[kept]
    along = np.arctan2(outward[:, 0], -outward[:, 1])  # the road on the left
    yaw = {
        "tree": rng.uniform(-np.pi, np.pi, len(at)),
        "bush": rng.uniform(-np.pi, np.pi, len(at)),
        "sign_post": site.travel(at),
        "billboard": site.travel(at) + rng.uniform(-0.5, 0.5, len(at)),
        "bench": along + np.pi / 2,
    }.get(kind, along)
    names = VARIANT_NAMES[kind]
    choices = [variant for variant, name in enumerate(names) if not planting.only or name in planting.only]
    models = rng.choice(choices, size=len(at) if kind in _MIXED else 1)
    models = np.broadcast_to(models, len(at))
    faces = np.array([len(build_asset(kind, variant).mesh.faces) for variant in range(len(names))])
    if "hedge" in names:
        yaw = np.where(models == names.index("hedge"), along, yaw)
    affordable = np.cumsum(faces[models]) <= _BUDGET.get(kind, 10_000)
    for variant in np.unique(models).tolist():
        chosen = np.flatnonzero((models == variant) & affordable)
        arm = build_asset(kind, variant).size[1] / 2 - 0.15 if names[variant].startswith("arm") else 0.0
        props.add(kind, variant, 0, at[chosen] - arm * outward[chosen], yaw[chosen])
