"""What things are made of: materials by name, and the paints that a class comes in.

Albedo is linear RGB; reflectivity is diffuse at 905 nm, after typical targets: tyre 0.04, glass 0.1, paint 0.2 to 0.7,
sign sheeting 0.9."""

from dataclasses import dataclass, replace

from data_gen.assets.shapes.mesh import Surface

RGB = tuple[float, float, float]


@dataclass(frozen=True)
class Material:
    """One material; the fields are those of ``mesh.Surface`` for a single face."""

    albedo: RGB
    reflectivity: float
    texture: str = "plain"
    specular: float = 0.0
    emission: float = 0.0

    def darker(self, share: float) -> "Material":
        """The same with ``share`` of the albedo: the shadow in a rib, an old sheet."""
        r, g, b = self.albedo
        return replace(self, albedo=(share * r, share * g, share * b))

    def on(self, count: int) -> Surface:
        """The surface of ``count`` faces of this material."""
        return Surface.uniform(
            count,
            self.albedo,
            self.reflectivity,
            texture=self.texture,
            specular=self.specular,
            emission=self.emission,
        )


def lacquer(rgb: RGB) -> Material:
    """Car paint: glossy where no dirt lies on it; pigments that are dark to the eye are mostly dark to the LiDAR."""
    return Material(rgb, 0.2 + 0.6 * _luminance(rgb), texture="lacquer", specular=0.2)


def cloth(rgb: RGB) -> Material:
    """Clothing: dull, and brighter at 905 nm than to the eye, as most dyes are transparent there."""
    return Material(rgb, 0.3 + 0.4 * _luminance(rgb), "fabric")


def _luminance(rgb: RGB) -> float:
    return 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]


TYRE = Material((0.018, 0.018, 0.019), 0.04)
RIM = Material((0.36, 0.37, 0.39), 0.35, "metal", 0.3)
GLASS = Material((0.022, 0.03, 0.036), 0.1, specular=0.5)
TRIM = Material((0.03, 0.03, 0.032), 0.08)
CHASSIS = Material((0.045, 0.045, 0.05), 0.12)
CHROME = Material((0.55, 0.56, 0.58), 0.5, "metal", 0.6)
PLATE = Material((0.80, 0.80, 0.76), 0.9)
HEAD_LAMP = Material((0.92, 0.92, 0.86), 0.5, specular=0.4, emission=30.0)  # 1,000 lm from 0.03 m^2
TAIL_LAMP = Material((0.62, 0.01, 0.012), 0.5, specular=0.3, emission=2.0)  # 10 cd from 0.015 m^2
AMBER = Material((0.85, 0.32, 0.01), 0.5, specular=0.3, emission=4.0)

STEEL = Material((0.36, 0.37, 0.38), 0.45, "metal", 0.25)
DARK_STEEL = Material((0.10, 0.10, 0.11), 0.2, "metal", 0.15)
ALUMINIUM = Material((0.52, 0.53, 0.54), 0.55, "metal", 0.35)
CONCRETE = Material((0.36, 0.35, 0.33), 0.3, "concrete")
TIMBER = Material((0.36, 0.22, 0.10), 0.45, "wood")
EARTH = Material((0.16, 0.10, 0.055), 0.25, "concrete")
BARK = Material((0.085, 0.058, 0.036), 0.3, "wood")
BIRCH_BARK = Material((0.46, 0.44, 0.40), 0.4, "wood")
LEATHER = Material((0.025, 0.02, 0.018), 0.2, "fabric")
WHITE_SHEETING = Material((0.82, 0.82, 0.82), 0.9)
RED_SHEETING = Material((0.55, 0.02, 0.02), 0.9)
BLUE_SHEETING = Material((0.015, 0.10, 0.45), 0.9)
YELLOW_SHEETING = Material((0.80, 0.50, 0.01), 0.88)
GREEN_SHEETING = Material((0.01, 0.20, 0.09), 0.9)
MACHINE_YELLOW = lacquer((0.80, 0.44, 0.015))
MACHINE_ORANGE = lacquer((0.75, 0.19, 0.015))
HI_VIS_YELLOW = Material((0.62, 0.90, 0.03), 0.85, "fabric")
HI_VIS_ORANGE = Material((0.95, 0.24, 0.02), 0.85, "fabric")
SKINS = tuple(Material(rgb, 0.5) for rgb in ((0.62, 0.38, 0.27), (0.36, 0.19, 0.11), (0.12, 0.06, 0.04)))
HAIRS = tuple(cloth(rgb) for rgb in ((0.02, 0.014, 0.01), (0.11, 0.055, 0.025), (0.42, 0.29, 0.12), (0.28, 0.27, 0.26)))

WHITE, SILVER, GREY, BLACK = (0.74, 0.74, 0.72), (0.40, 0.41, 0.42), (0.12, 0.125, 0.135), (0.014, 0.014, 0.016)
RED, BLUE, GREEN, BEIGE = (0.42, 0.015, 0.018), (0.02, 0.075, 0.34), (0.02, 0.14, 0.06), (0.44, 0.35, 0.21)

CAR_PAINTS = tuple(
    lacquer(rgb)
    for rgb in (
        WHITE, SILVER, GREY, BLACK, RED, BLUE, GREEN, BEIGE, (0.055, 0.06, 0.07), (0.64, 0.63, 0.58), (0.006, 0.014, 0.13),
        (0.13, 0.012, 0.02), (0.16, 0.30, 0.46), (0.60, 0.17, 0.015), (0.24, 0.245, 0.25), (0.16, 0.09, 0.045),
    )
)  # fmt: skip
TRUCK_PAINTS = tuple(lacquer(rgb) for rgb in (WHITE, (0.45, 0.02, 0.02), (0.02, 0.10, 0.38), (0.03, 0.22, 0.10)))
BUS_PAINTS = tuple(
    lacquer(rgb) for rgb in ((0.62, 0.03, 0.03), (0.72, 0.72, 0.68), (0.02, 0.14, 0.46), (0.03, 0.30, 0.13))
)
TRAILER_PAINTS = tuple(lacquer(rgb) for rgb in (WHITE, (0.03, 0.11, 0.36), (0.48, 0.03, 0.03), (0.30, 0.31, 0.32)))
MOTORCYCLE_PAINTS = tuple(lacquer(rgb) for rgb in (RED, BLACK, BLUE, WHITE))
BICYCLE_PAINTS = tuple(lacquer(rgb) for rgb in (RED, BLUE, (0.55, 0.56, 0.57), (0.02, 0.22, 0.20)))
# What people wear: (top, bottom, shoes)
CLOTHES = tuple(
    (cloth(top), cloth(bottom), cloth(shoes))
    for top, bottom, shoes in (
        ((0.55, 0.03, 0.03), (0.03, 0.05, 0.12), (0.03, 0.03, 0.03)),
        ((0.03, 0.09, 0.32), (0.30, 0.25, 0.17), (0.10, 0.05, 0.03)),
        ((0.68, 0.68, 0.66), (0.02, 0.02, 0.025), (0.60, 0.60, 0.58)),
        ((0.03, 0.03, 0.035), (0.06, 0.08, 0.16), (0.03, 0.03, 0.03)),
        ((0.05, 0.20, 0.09), (0.12, 0.11, 0.10), (0.10, 0.05, 0.03)),
        ((0.70, 0.45, 0.06), (0.05, 0.07, 0.14), (0.50, 0.50, 0.48)),
        ((0.30, 0.06, 0.24), (0.02, 0.02, 0.02), (0.02, 0.02, 0.02)),
        ((0.30, 0.31, 0.33), (0.10, 0.13, 0.22), (0.03, 0.03, 0.03)),
    )
)
