"""How wet the ground is: one answer for camera, LiDAR and spray.

Water first fills the texture of a surface: until then the road is damp, dark and dry to every sensor's ray. A thicker film
covers a growing fraction of it, until the texture has drowned. What the texture does not hold, tyres throw up.
"""

from dataclasses import dataclass

import numpy as np

from data_gen.world.ground import GROUND_NAMES

DAMP_FILM = 0.05
"""Millimetres up to which nothing but the colour changes."""
DARK_FILM = 0.2
"""Millimetres at which the pores are full and the surface is as dark as it gets."""
HELD_FILM = 0.3
"""Millimetres that the texture of the road holds back from the tyres."""
DROWNED_FILM = 1.2
"""Millimetres under which the texture of asphalt has drowned (LiDAR_snow_sim)."""
ABSORBING = np.isin(GROUND_NAMES, ("grass", "dry_grass", "gravel"))
"""(G,) which materials of the ground hold no film of water."""


@dataclass(frozen=True)
class Wetness:
    """A ``film`` of water in mm on the paved ground of a scene."""

    film: float

    @property
    def is_wet(self) -> bool:
        """Whether water stands on the road: it mirrors, LiDAR loses the far ground, tyres may throw spray."""
        return self.film > DAMP_FILM

    @property
    def covered(self) -> float:
        """Fraction of the paved ground that water covers: 0 on a damp road, 1 where the texture has drowned."""
        return min(max(self.film - DAMP_FILM, 0.0) / (DROWNED_FILM - DAMP_FILM), 1.0)

    @property
    def darkened(self) -> float:
        """How far the colour of the paved ground is on its way from dry to soaked, 0 to 1."""
        return min(self.film / DARK_FILM, 1.0)

    @property
    def feeds_spray(self) -> bool:
        """Whether tyres find more water than the texture holds back."""
        return self.film > HELD_FILM
