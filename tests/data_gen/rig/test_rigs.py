"""Rigs of any kind, through the generator and the reader: one keyframe each."""

from dataclasses import replace

import numpy as np
import pytest
from hydra import compose, initialize_config_dir

from data_gen.generate import DataConfig, Job, generate
from data_gen.recording.schedule import keyframe_times
from data_gen.rig.rig import Rig
from data_gen.scene.conditions import ConditionMix, Preset
from fusion_net.common.cli.command import CONFIGS, build
from fusion_net.common.fault_effects import FewerBeams
from fusion_net.common.faults import Fault, FaultPlan
from fusion_net.data.samples import SampleReader
from fusion_net.nuscenes.nuscenes import NuScenes
from tests.fixtures.lidar_models import HDL64E, VLP16, shipped
from tests.fixtures.scenarios import MIXED
from tests.fixtures.small_rig import camera, lidar, radar

CLEAR = ConditionMix(
    presets={"clear": [Preset(illuminance=[40_000.0, 80_000.0], sun_elevation=[30.0, 60.0])]}, weights={"clear": 1.0}
)


def generated(root, *, cameras, radars, lidars=None):
    rig = Rig(name="mine", cameras=cameras, lidars=lidars or {"LIDAR_TOP": lidar()}, radars=radars, sweeps={"radar": 1})
    data = DataConfig(name="mine", root=str(root), num_scenes=1, keyframes=1, split_weights={"train": 1})
    job = Job(data=data, rig=rig, scenario=replace(MIXED, layouts={"train": {"two_way": 1}}), condition=CLEAR, seed=3)
    generate(job, settings={}, workers=1)
    tree = NuScenes(root)
    (token,) = tree.split("all")
    return tree, token


def test_without_cameras_or_radars_the_lidar_is_left(tmp_path):
    tree, token = generated(tmp_path / "tree", cameras={}, radars={})
    sample = SampleReader(label_stride=None).read(tree, token)
    assert sample.images.shape[0] == 0
    assert len(sample.lidar_points) > 500
    assert len(sample.radar_points) == 0
    assert sample.present.tolist() == [False, True, False]


@pytest.fixture(scope="module")
def unlike(tmp_path_factory):
    """A wide camera ahead and a small one behind."""
    cameras = {
        "CAM_FRONT": camera(width=120, height=40, hfov_deg=100.0),
        "CAM_BACK": camera(width=48, height=56, hfov_deg=50.0, translation=[0.0, 0.0, 1.5], rotation_deg=[0.0, 2.0, 181.0]),
    }  # fmt: skip
    return generated(tmp_path_factory.mktemp("unlike") / "tree", cameras=cameras, radars={"RADAR_FRONT": radar()})


def test_cameras_may_be_of_unlike_size(unlike):
    tree, token = unlike
    sizes = {
        c: (tree.keyframes[token][c]["height"], tree.keyframes[token][c]["width"]) for c in ("CAM_FRONT", "CAM_BACK")
    }
    assert sizes == {"CAM_FRONT": (40, 120), "CAM_BACK": (56, 48)}
    for channel, size in sizes.items():
        assert SampleReader(cameras=[channel]).read(tree, token).images.shape == (1, *size, 3)
    both = SampleReader(image_size=[16, 48]).read(tree, token)
    assert both.images.shape == (2, 16, 48, 3)
    assert both.images.reshape(2, -1).std(axis=1).min() > 5


def test_a_reader_of_unlike_sizes_says_what_to_give(unlike):
    with pytest.raises(ValueError, match=r"cameras of unlike sizes .* give image_size"):
        SampleReader(label_stride=None).read(*unlike)


def test_objects_stand_all_round_a_rig_that_looks_all_round(tmp_path):
    def boxes(*yaws):
        cameras = {f"CAM_{i}": camera(rotation_deg=[0.0, 0.0, yaw], hfov_deg=90.0) for i, yaw in enumerate(yaws)}
        sample = SampleReader(label_stride=None).read(*generated(tmp_path / str(len(yaws)), cameras=cameras, radars={}))
        return np.degrees(np.arctan2(*sample.boxes.center[:, 1::-1].T))

    front, round_ = boxes(0.0), boxes(0.0, 90.0, 180.0, -90.0)
    assert len(round_) > 1.5 * len(front)
    assert np.histogram(round_, bins=[-180, -90, 0, 90, 180])[0].min() >= 2


def test_a_data_set_has_the_rig_of_its_name_unless_told_otherwise():
    def rig_of(*overrides):
        with initialize_config_dir(str(CONFIGS), version_base="1.3"):
            return compose("data_gen", overrides=list(overrides)).rig.name

    assert rig_of() == rig_of("data=nano") == rig_of("data=surround", "rig=nano") == "nano"
    assert rig_of("data=surround") == rig_of("rig=surround") == "surround"


def test_the_experiment_of_surround_trains_on_its_data_and_grid():
    with initialize_config_dir(str(CONFIGS), version_base="1.3"):
        cfg = compose("train", overrides=["experiment=surround", "trainer=smoke"])
    assert (cfg.data.root, cfg.name, cfg.trainer.batch_size) == ("data/surround", "surround", 2)
    assert (cfg.grid.x_min, cfg.grid.x_max) == (-44.8, 57.6)


def composed(*overrides):
    with initialize_config_dir(str(CONFIGS), version_base="1.3"):
        return build(compose("data_gen", overrides=list(overrides)).rig, "rig")


@pytest.mark.parametrize("data", ["nano", "surround"])
@pytest.mark.parametrize(("name", "beams"), [("hdl32e", 32), ("vlp16", 16), ("hdl64e", 64)])
def test_every_rig_takes_every_lidar(data, name, beams):
    rig = composed(f"data={data}", f"lidar={name}")
    assert rig.lidars["LIDAR_TOP"].model == shipped(name)
    assert rig.lidars["LIDAR_TOP"].model.beams == beams


def test_an_episode_has_room_for_the_sweeps_before_its_first_keyframe():
    for data in ("nano", "surround"):
        rig = composed(f"data={data}")
        assert rig.duration(4) == 3.0
        first, last = keyframe_times(rig, 4)[[0, -1]]
        for channel, mount in rig.sensors.items():
            past = rig.past_events(channel)
            written = (past + 1) / mount.rate if isinstance(past, int) else 1 / rig.keyframe_rate + 1 / mount.rate
            assert first - written > 0
        assert last < rig.duration(4)


def test_the_default_lidar_is_the_hdl_32e_with_every_column():
    assert composed("data=nano").lidars["LIDAR_TOP"] == replace(
        composed("lidar=hdl32e", "rig.lidars.LIDAR_TOP.columns=2170").lidars["LIDAR_TOP"], columns=None
    )
    assert composed("data=nano").lidars["LIDAR_TOP"].turn_columns == 2170
    assert composed("lidar=vlp16").lidars["LIDAR_TOP"].turn_columns == 1808
    assert composed("lidar=hdl64e", "lidar.max_range=80.0").lidars["LIDAR_TOP"].max_range == 80.0


@pytest.mark.parametrize(("model", "keep"), [(VLP16, 4), (HDL64E, 16)], ids=["VLP-16", "HDL-64E"])
def test_other_lidars_are_generated_read_and_robbed_of_beams(tmp_path, model, keep):
    """The reader knows the number of beams from the tables: of 16 beams every fourth is left, and of 64."""
    tree, token = generated(tmp_path / "tree", cameras={}, radars={}, lidars={"LIDAR_TOP": lidar(model=model)})
    assert tree.beams == {"LIDAR_TOP": model.beams}
    ring = np.fromfile(tree.path(tree.reference(token)), "<f4").reshape(-1, 5)[:, 4]
    assert ring.max() < model.beams
    assert len(np.unique(ring)) > 0.6 * model.beams  # the others look into the sky

    def points(*effects):
        faults = [Fault(sensors=["lidar"], effect=effect) for effect in effects]
        return len(SampleReader(label_stride=None, faults=faults).read(tree, token).lidar_points)

    assert points() == len(ring)
    assert points(FewerBeams(keep=keep)) == np.count_nonzero(ring % 4 == 0)
    no_fault = FaultPlan([Fault(sensors=["lidar"], effect=FewerBeams(keep=model.beams))])
    with pytest.raises(
        ValueError, match=rf"takes no beam from LIDAR_TOP, which has {model.beams}; use 1 to {model.beams - 1}"
    ):
        no_fault.check(tree.modalities, tree.beams)
