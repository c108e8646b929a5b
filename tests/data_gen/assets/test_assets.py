"""Bodies: boxes that fit, normals that point out, materials that tell, decoys that only a camera can tell."""

from dataclasses import fields

import numpy as np
import pytest
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from data_gen.assets.catalogue import (
    PAINTS,
    PROPS,
    VARIANT_NAMES,
    VARIANTS,
    _build,
    build_asset,
    decoy_of,
    scaled_decoy,
)
from data_gen.assets.shapes.mesh import TEXTURES
from fusion_net.common.nuscenes_format import CATEGORY_TO_CLASS, CLASSES
from tests.fixtures.bodies import every_body

# length, width, height of nuScenes' training boxes (means) in metres
MEANS = {
    "car": (4.6, 1.95, 1.73),
    "truck": (6.9, 2.5, 2.8),
    "bus": (11.0, 2.9, 3.5),
    "trailer": (12.0, 2.9, 3.9),
    "construction_vehicle": (6.4, 2.8, 3.2),
    "pedestrian": (0.73, 0.67, 1.77),
    "motorcycle": (2.1, 0.77, 1.5),
    "bicycle": (1.7, 0.6, 1.3),
    "traffic_cone": (0.41, 0.41, 1.07),
    "barrier": (0.5, 2.5, 0.98),
}


def face_normals(mesh):
    a, b, c = (mesh.vertices[mesh.faces[:, i]].astype(float) for i in range(3))
    return np.cross(b - a, c - a)


@every_body
def test_box_contains_mesh_tightly_and_sits_on_the_ground(kind, variant):
    asset = build_asset(kind, variant, PAINTS[kind] - 1)
    low, high = asset.mesh.vertices.min(axis=0), asset.mesh.vertices.max(axis=0)
    length, width, height = asset.size
    np.testing.assert_allclose(low, (-length / 2, -width / 2, 0), atol=0.01)
    np.testing.assert_allclose(high, (length / 2, width / 2, height), atol=0.01)


@every_body
def test_mesh_is_sound(kind, variant):
    mesh = build_asset(kind, variant).mesh
    assert mesh.vertices.dtype == np.float32
    assert mesh.faces.dtype == np.int32
    assert mesh.faces.min() >= 0
    assert mesh.faces.max() < len(mesh.vertices)
    assert len(mesh.faces) <= 900
    assert np.isfinite(mesh.vertices).all()
    assert np.linalg.norm(face_normals(mesh), axis=1).min() > 0
    for field in fields(mesh.surface):
        assert len(getattr(mesh.surface, field.name)) == len(mesh.faces)
    assert mesh.surface.texture.max() < len(TEXTURES)
    for name, high in (("albedo", 1.0), ("specular", 1.0), ("reflectivity", 0.95)):
        values = getattr(mesh.surface, name)
        assert values.min() >= 0
        assert values.max() <= high


@every_body
def test_only_front_faces_are_seen_from_outside(kind, variant):
    asset = build_asset(kind, variant)
    scene = EmbreeScene()
    TriangleMesh(scene, asset.mesh.vertices, asset.mesh.faces)
    rng = np.random.default_rng(3)
    away = rng.normal(size=(4000, 3))
    away[:, 2] = np.abs(away[:, 2])
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    target = rng.uniform(asset.mesh.vertices.min(axis=0), asset.mesh.vertices.max(axis=0), (4000, 3))
    reach = 2 * float(np.linalg.norm(asset.size))
    hit = scene.run(
        (target + reach * away).astype(np.float32), (-away).astype(np.float32), query="INTERSECT", output=True
    )
    met = hit["primID"] >= 0
    normal = face_normals(asset.mesh)[hit["primID"][met]]
    wrong = np.einsum("ij,ij->i", normal, away[met]) < 0
    assert met.sum() > 100
    assert wrong.mean() < 0.005


@pytest.mark.parametrize("kind", CLASSES)
def test_class_has_variants_paints_and_plausible_sizes(kind):
    assets = [build_asset(kind, variant) for variant in range(VARIANTS[kind])]
    assert len(assets) >= 3
    assert {CATEGORY_TO_CLASS[asset.category] for asset in assets} == {kind}
    assert len({asset.size for asset in assets}) >= 3
    sizes = np.array([asset.size for asset in assets])
    assert np.all(sizes.mean(axis=0) / MEANS[kind] > 0.7)
    assert np.all(sizes.mean(axis=0) / MEANS[kind] < 1.35)


def test_categories_that_the_classes_split_into():
    def categories(kind):
        return {build_asset(kind, variant).category for variant in range(VARIANTS[kind])}

    assert categories("bus") == {"vehicle.bus.rigid", "vehicle.bus.bendy"}
    assert categories("pedestrian") == {
        f"human.pedestrian.{kind}" for kind in ("adult", "child", "construction_worker", "police_officer")
    }
    for kind in PROPS:
        assert categories(kind) == {""}
    for kind in ("motorcycle", "bicycle"):
        assert {name.split()[-1] for name in VARIANT_NAMES[kind]} == {"rider", "parked"}


def test_vehicles_are_more_than_boxes_and_paints_differ():
    for kind in ("car", "truck", "bus", "trailer", "construction_vehicle"):
        counts = [len(build_asset(kind, variant).mesh.faces) for variant in range(VARIANTS[kind])]
        assert min(counts) >= 150
    for kind in ("car", "truck", "bus", "trailer", "construction_vehicle", "pedestrian", "motorcycle", "bicycle"):
        looks = [build_asset(kind, 0, paint).mesh.surface.albedo for paint in range(PAINTS[kind])]
        assert PAINTS[kind] >= 2
        assert all(np.abs(a - b).max() > 0.05 for i, a in enumerate(looks) for b in looks[:i])
    assert PAINTS["car"] >= 8
    assert PAINTS["pedestrian"] >= 6


@pytest.mark.parametrize("kind", ["car", "truck", "bus"])
def test_lamps_are_small_white_in_front_and_red_behind(kind):
    for variant in range(VARIANTS[kind]):
        mesh = build_asset(kind, variant).mesh
        normal = face_normals(mesh)
        area = np.linalg.norm(normal, axis=1) / 2
        bright = mesh.surface.emission > 0
        ahead, behind = bright & (normal[:, 0] > 0.9 * 2 * area), bright & (normal[:, 0] < -0.9 * 2 * area)
        white = ahead & (mesh.surface.albedo.min(axis=1) > 0.5)
        red = behind & (mesh.surface.albedo[:, 0] > 10 * mesh.surface.albedo[:, 1])
        assert white.any()
        assert red.any()
        assert area[bright].sum() < 0.06 * area.sum()


def test_a_walking_person_has_two_legs_and_a_head():
    asset = build_asset("pedestrian", VARIANT_NAMES["pedestrian"].index("man walking"))
    scene = EmbreeScene()
    TriangleMesh(scene, asset.mesh.vertices, asset.mesh.faces)
    x = np.linspace(-asset.size[0] / 2, asset.size[0] / 2, 400)

    def runs(share):
        """Separate stretches that the person covers along x at a share of the height, seen from the side."""
        origins = np.stack([x, np.full(400, -5.0), np.full(400, share * asset.size[2])], axis=1).astype(np.float32)
        hit = (
            scene.run(origins, np.tile(np.float32([0, 1, 0]), (400, 1)), query="INTERSECT", output=True)["primID"] >= 0
        )
        return int((np.diff(np.concatenate([[0], hit.astype(int)])) == 1).sum()), hit.mean() * asset.size[0]

    assert runs(0.15)[0] == 2
    assert runs(0.94)[0] == 1
    assert runs(0.94)[1] < 0.35


def test_who_walks_moves_legs_and_arms_within_the_box():
    for variant, name in enumerate(VARIANT_NAMES["pedestrian"]):
        asset = build_asset("pedestrian", variant)
        assert bool(asset.gait) == ("walking" in name)
        for phase in asset.gait:
            assert len(phase.faces) == len(asset.mesh.faces)
            np.testing.assert_array_equal(phase.faces, asset.mesh.faces)
            assert (np.abs(phase.vertices[:, :2]) <= np.array(asset.size[:2]) / 2 + 0.02).all()
            assert phase.vertices[:, 2].min() == pytest.approx(0.0, abs=1e-3)
            assert phase.vertices[:, 2].max() == pytest.approx(asset.size[2], abs=1e-3)
    walker = build_asset("pedestrian", VARIANT_NAMES["pedestrian"].index("man walking"))
    np.testing.assert_allclose(walker.gait[0].vertices, walker.mesh.vertices, atol=1e-3)
    half = len(walker.gait) // 2  # half a stride later left and right have changed places
    ahead = [phase.vertices[phase.vertices[:, 2] < 0.25] for phase in (walker.gait[0], walker.gait[half])]
    leading = [np.sign(feet[feet[:, 0].argmax(), 1]) for feet in ahead]
    assert leading[0] == -leading[1] != 0
    assert scaled_decoy(walker).gait == ()


def test_reflectivity_follows_material():
    surface = build_asset("car", 0, 0).mesh.surface
    dark_tyre = surface.reflectivity[surface.albedo.max(axis=1) < 0.02]
    assert dark_tyre.max() < 0.06
    assert (surface.reflectivity > 0.85).any()  # plates
    white, black = (build_asset("car", 0, paint).mesh.surface for paint in (0, 3))
    assert white.reflectivity[0] > black.reflectivity[0] + 0.3  # face 0 is the flank
    worker = build_asset("pedestrian", VARIANT_NAMES["pedestrian"].index("worker walking")).mesh.surface
    assert (worker.reflectivity > 0.8).mean() > 0.1


@every_body
def test_decoy_differs_for_the_camera_alone(kind, variant):
    asset = build_asset(kind, variant)
    decoy = decoy_of(asset)
    assert decoy is decoy_of(asset)
    assert decoy.category == ""
    assert decoy.size == asset.size
    np.testing.assert_array_equal(decoy.mesh.vertices, asset.mesh.vertices)
    np.testing.assert_array_equal(decoy.mesh.faces, asset.mesh.faces)
    np.testing.assert_array_equal(decoy.mesh.surface.reflectivity, asset.mesh.surface.reflectivity)
    for field in fields(asset.scatterers):
        np.testing.assert_array_equal(getattr(decoy.scatterers, field.name), getattr(asset.scatterers, field.name))
    distance = np.linalg.norm(decoy.mesh.surface.albedo - asset.mesh.surface.albedo, axis=1)
    assert distance.min() > 0.4
    assert decoy.mesh.surface.emission.max() == 0
    assert np.all(decoy.mesh.surface.texture == TEXTURES.index("billboard"))


def test_scaled_decoy_looks_alike_at_twice_the_distance():
    child = build_asset("pedestrian", VARIANT_NAMES["pedestrian"].index("child standing"))
    figure = scaled_decoy(child, 2.0)
    assert figure is scaled_decoy(child, 2.0)
    assert figure.category == ""
    eye = np.array([0.0, 0.0, 1.5])
    near, far = (
        asset.mesh.vertices + np.array([x, 0, 0]) - eye * s for asset, x, s in ((child, 15, 1), (figure, 30, 2))
    )
    np.testing.assert_allclose(near[:, 1:] / near[:, :1], far[:, 1:] / far[:, :1], atol=1e-5)
    assert figure.mesh.surface is child.mesh.surface
    np.testing.assert_allclose(figure.scatterers.rcs - child.scatterers.rcs, 6.02, atol=0.01)
    with pytest.raises(ValueError, match="scale=-1"):
        scaled_decoy(child, -1.0)


def test_same_arguments_give_the_same_object_and_the_same_bytes():
    assert build_asset("tree") is build_asset("tree", 0, 0)
    first = build_asset("tree", 1)
    again = _build.__wrapped__("tree", 1, 0)
    assert again is not first
    np.testing.assert_array_equal(again.mesh.vertices, first.mesh.vertices)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [(("lorry",), "kind 'lorry'"), (("car", 99), "variant=99"), (("car", 0, -1), "paint=-1")],
)
def test_unknown_body_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        build_asset(*arguments)
