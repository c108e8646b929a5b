"""The camera against geometry and photometry: an off-centre, tilted camera in a small street."""

import math

import numpy as np
import pytest
import trimesh

from data_gen.assets.shapes.mesh import Asset, Mesh, Scatterers, Surface
from data_gen.rig.mounts import Camera
from data_gen.road.track import Track
from data_gen.scene.conditions import Condition
from data_gen.scene.light import light_of
from data_gen.scene.noise import band
from data_gen.scene.scene import NOTHING, WORLD, Actor, Scene
from data_gen.sensors.camera.camera import render_luminance, sense
from data_gen.sensors.camera.imaging import auto_exposure, develop
from data_gen.sensors.common.event import CaptureEvent
from data_gen.world.ground import GROUND_NAMES, GroundMap
from fusion_net.common.geometry import from_rpy, invert, project, transform
from fusion_net.common.random import stream

NO_SCATTERERS = Scatterers(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.float32), np.zeros(0, np.float32))
CAMERA = Camera(
    translation=[1.7, 0.2, 1.5], rotation_deg=[1.5, 4.0, -3.0], width=160, height=72, hfov_deg=64.0,
    principal=[85.0, 31.0], rate=30.0,
)  # fmt: skip
EGO = (20.0, 48.0, 0.1)


def make_box(size, albedo, **surface) -> Mesh:
    box = trimesh.creation.box(size)
    box.apply_translation((0, 0, size[2] / 2))
    faces = np.asarray(box.faces, np.int32)
    return Mesh(np.asarray(box.vertices, np.float32), faces, Surface.uniform(len(faces), albedo, 0.3, **surface))


def make_scene(*actors: tuple, condition: Condition | None = None, paint: slice | None = None) -> Scene:
    """A level 120 x 100 m field of asphalt; an actor is (size, albedo, (x, y), yaw)."""
    material = np.full((1000, 1200), GROUND_NAMES.index("asphalt"), np.uint8)
    if paint is not None:
        material[paint] = GROUND_NAMES.index("white_paint")
    corners = np.array([[0, 0, 0], [120, 0, 0], [120, 100, 0], [0, 100, 0]], np.float32)
    ground = Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), Surface.uniform(2, (0.1, 0.1, 0.1), 0.1))
    bodies = [
        Actor(
            i, Asset("box", "vehicle.car", size, make_box(size, albedo), NO_SCATTERERS), Track.static((*xy, 0.0), yaw)
        )
        for i, (size, albedo, xy, yaw) in enumerate(actors)
    ]
    return Scene(
        name="test", ego=Track.static((EGO[0], EGO[1], 0.0), EGO[2]), actors=bodies, world=ground, ground_faces=2,
        ground=GroundMap(material, (0.0, 0.0), 0.1), world_scatterers=NO_SCATTERERS, condition=condition or Condition(),
    )  # fmt: skip


def global_T_cam(scene: Scene) -> np.ndarray:
    return scene.ego.pose(0.0) @ CAMERA.ego_T_sensor


def pixel_of(scene: Scene, point) -> tuple[int, int]:
    """Row and column of the pixel that shows a global point."""
    (uv,), _ = project(CAMERA.cam_K, transform(invert(global_T_cam(scene)), [point]))
    return int(uv[1]), int(uv[0])


def shoot(scene: Scene, seed: int = 1, **kwargs):
    return sense(scene, CaptureEvent.nominal(CAMERA, 0.0, stream(seed, "camera"), **kwargs))


@pytest.fixture(scope="module")
def street() -> Scene:
    return make_scene(
        ((4.0, 2.0, 1.6), (0.6, 0.05, 0.05), (36.0, 51.0), 0.5), ((1.0, 1.0, 2.0), (0.1, 0.1, 0.5), (30.0, 47.0), 0.2)
    )


def test_a_box_covers_exactly_the_hull_of_its_projected_corners(street):
    frame = shoot(street)
    actor = street.actors[0]
    corners = transform(actor.track.pose(0.0), actor.asset.mesh.vertices)
    pixels, _ = project(CAMERA.cam_K, transform(invert(global_T_cam(street)), corners))
    rows, columns = np.nonzero(frame.body == 0)
    # Pixel centres at +0.5: the outermost centres lie inside the hull and less than a pixel from it.
    for seen, hull in ((columns + 0.5, pixels[:, 0]), (rows + 0.5, pixels[:, 1])):
        assert 0 <= seen.min() - hull.min() < 1
        assert 0 <= hull.max() - seen.max() < 1


def test_depth_is_along_z_and_not_along_the_ray(street):
    frame = shoot(street)
    rows, columns = np.nonzero(frame.body == WORLD)
    rays = np.stack([columns + 0.5, rows + 0.5, np.ones(len(rows))], axis=1) @ np.linalg.inv(CAMERA.cam_K).T
    points = transform(global_T_cam(street), rays * frame.depth[rows, columns, None])
    np.testing.assert_allclose(points[:, 2], 0.0, atol=2e-3)  # the ground


def test_body_image_and_depth_agree(street):
    frame = shoot(street)
    assert np.array_equal(np.isinf(frame.depth), frame.body == NOTHING)
    assert (frame.depth[frame.body == NOTHING + 1] > 0).all()
    np.testing.assert_array_equal(frame.reached, [np.count_nonzero(frame.body == i) for i in (0, 1)])
    assert (frame.aimed >= frame.reached).all()


def test_the_nearer_body_hides_the_farther():
    far, near = (
        ((3.0, 3.0, 3.0), (0.5, 0.5, 0.5), (40.0, 50.0), 0.0),
        ((2.0, 1.0, 1.2), (0.5, 0.0, 0.0), (32.0, 49.2), 0.0),
    )
    scene = make_scene(far, near)
    frame = shoot(scene)
    row, column = pixel_of(scene, (31.0, 49.2, 0.6))
    assert frame.body[row, column] == 1
    assert frame.depth[row, column] < 11
    assert 0 < frame.reached[0] < frame.aimed[0]


@pytest.mark.parametrize(("azimuth", "shaded", "sunny"), [(90.0, -1, 1), (-90.0, 1, -1)])
def test_the_shadow_lies_away_from_the_sun(azimuth, shaded, sunny):
    scene = make_scene(
        ((6.0, 2.0, 2.0), (0.5, 0.5, 0.5), (33.0, 49.5), 0.0),
        condition=Condition(sun_azimuth=azimuth, sun_elevation=50.0),
    )
    light, _ = render_luminance(scene, CAMERA, t=0.0)
    beside = {side: light[pixel_of(scene, (32.0, 49.5 + 1.6 * side, 0.0))][1] for side in (shaded, sunny)}
    assert beside[shaded] < 0.5 * beside[sunny]


def test_haze_takes_contrast_as_koschmieder_says():
    """Dark and bright bodies at the same distance: their difference falls as exp(-extinction * ray length)."""
    bodies = [((1.0, 1.5, 2.0), (a, a, a), (50.0, y), 0.0) for a, y in ((0.05, 49.0), (0.8, 53.0))]
    hazy, clear = Condition(visibility=100.0, sun_elevation=-5.0), Condition(visibility=1e9, sun_elevation=-5.0)
    contrast = {}
    for name, condition in (("hazy", hazy), ("clear", clear)):
        scene = make_scene(*bodies, condition=condition)
        light, hits = render_luminance(scene, CAMERA, t=0.0)
        at = [pixel_of(scene, (49.5, y, 1.3)) for y in (49.0, 53.0)]
        contrast[name] = light[at[1]][1] - light[at[0]][1]
        distance = np.mean([hits.distance[row * CAMERA.width + column] for row, column in at])
    expected = math.exp(-hazy.extinction * distance)
    assert contrast["hazy"] / contrast["clear"] == pytest.approx(expected, rel=0.05)


def test_the_same_generator_gives_the_same_bytes(street):
    first, again, other = shoot(street, 7).image, shoot(street, 7).image, shoot(street, 8).image
    assert first.tobytes() == again.tobytes()
    assert first.tobytes() != other.tobytes()


def test_night_is_darker_than_day_but_for_lamps(street):
    night = make_scene(
        ((4.0, 2.0, 1.6), (0.6, 0.05, 0.05), (36.0, 51.0), 0.5),
        condition=Condition("night", illuminance=5.0, sun_elevation=-30.0),
    )
    day_image, night_image = shoot(street).image, shoot(night).image
    assert night_image.mean() < 0.6 * day_image.mean()
    light, _ = render_luminance(night, CAMERA, t=0.0)
    lit, dark = light[pixel_of(night, (34.0, 49.4, 0.0))][1], light[pixel_of(night, (34.0, 57.0, 0.0))][1]
    assert lit > 1.5 * dark  # inside and outside the low beams


def test_an_edge_pixel_lies_between_its_two_sides():
    scene = make_scene(((1.0, 4.0, 4.0), (0.8, 0.8, 0.8), (34.0, 51.0), 0.1), condition=Condition(sun_elevation=-5.0))
    light, _ = render_luminance(scene, CAMERA, t=0.0)
    body = shoot(scene).body
    row, column = pixel_of(scene, (33.5, 51.0, 1.0))
    right = column + int(np.argmax(body[row, column:] != 0))  # first pixel beyond the right edge
    strip = light[row, right - 4 : right + 4, 1]
    inside, outside = strip[:2].mean(), strip[-2:].mean()
    low, high = sorted((inside, outside))
    edge = strip[3:5]
    assert ((edge > low * 0.97) & (edge < high * 1.03)).all()
    assert ((edge > low + 0.05 * (high - low)) & (edge < high - 0.05 * (high - low))).any()


def test_paint_far_away_covers_its_share_of_a_pixel():
    """A 0.4 m stripe across the view at 60 m is thinner than a pixel's 9 m of ground: it lightens it, and does not vanish."""
    plain, painted = (render_luminance(make_scene(paint=rows), CAMERA, t=0.0)[0] for rows in (None, np.s_[:, 800:804]))
    scene = make_scene()
    row, column = pixel_of(scene, (80.2, 54.0, 0.0))
    gain = (painted / plain)[row - 2 : row + 3, column, 1]
    assert 1.005 < gain.max() < 1.6


def test_mount_override_moves_the_picture(street):
    turned = from_rpy(0.0, 0.0, math.radians(2.0)) @ CAMERA.ego_T_sensor
    nominal, knocked = shoot(street).body, shoot(street, ego_T_sensor=turned).body
    shift = np.nonzero(knocked == 0)[1].mean() - np.nonzero(nominal == 0)[1].mean()
    assert shift == pytest.approx(math.radians(2.0) * CAMERA.cam_K[0, 0], abs=1.0)  # turned left: things move right


@pytest.mark.parametrize("lux", [400.0, 8_000.0, 60_000.0])
def test_exposure_puts_the_log_average_at_the_key(lux):
    luminance = np.full((20, 30, 3), 0.2 * lux / math.pi, np.float32)
    exposure, iso, _ = auto_exposure(luminance)
    assert exposure * luminance[0, 0, 0] == pytest.approx(0.18, rel=1e-3)
    assert iso == 100.0 or lux < 1_000


def test_gain_runs_out_in_the_dark():
    dim = np.full((20, 30, 3), 0.01, np.float32)
    exposure, iso, _ = auto_exposure(dim)
    assert iso == 1600.0
    assert exposure * 0.01 < 0.01


def test_noise_grows_with_gain():
    spread = {}
    for level in (1000.0, 1.0):
        image = develop(np.full((64, 64, 3), level, np.float32), stream(3, "noise")).astype(float)
        spread[level] = image[24:40, 24:40].std()
    assert spread[1.0] > 2 * spread[1000.0]


def test_daylight_adds_up_to_the_illuminance():
    for condition in (
        Condition(),
        Condition("overcast", illuminance=9_000.0),
        Condition("low", illuminance=20_000.0, sun_elevation=20.0),
    ):
        light = light_of(condition, "scene")
        total = (light.ambient + light.sun * light.sun_direction[2])[1]
        assert total == pytest.approx(condition.illuminance, rel=0.15)
    assert not light_of(Condition("fog", visibility=60.0), "scene").sun.max() > 5_000  # no shadows in fog


def test_band_is_the_exact_mean_of_a_stripe_pattern():
    x = np.linspace(0.0, 7.0, 70_001)
    stripes = (x % 1.3) < 0.4
    for middle, width in ((2.0, 0.05), (3.3, 0.7), (3.5, 5.0)):
        window = np.abs(x - middle) <= width / 2
        assert band(middle, 1.3, 0.0, 0.4, width) == pytest.approx(stripes[window].mean(), abs=2e-3)
