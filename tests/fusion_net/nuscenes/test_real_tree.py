"""Real nuScenes as its owner has it: read, trained on and scored without being prepared."""

import json
import shutil

import numpy as np
import pytest
from hydra import compose, initialize_config_dir

from fusion_net.common.cli.command import CONFIGS
from fusion_net.data.cameras import fit_image
from fusion_net.data.samples import SampleReader
from fusion_net.evaluate import evaluate_run
from fusion_net.fit import fit
from fusion_net.nuscenes.datasets import open_datasets, samples_of_split
from fusion_net.nuscenes.nuscenes import NuScenes
from fusion_net.nuscenes.splits import OFFICIAL, official_splits
from fusion_net.reports.statistics import write_statistics
from fusion_net.viz.lidar_check import write_check
from tests.fixtures.real_tree import SCENES, edit, write_real_tree
from tests.fixtures.tiny_tree import write_tree
from tests.fixtures.training_setup import settings

STEPS = ("trainer.camera_steps=1", "trainer.camera_only_steps=1", "trainer.fusion_steps=2", "trainer.validate_every=4")


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    return write_real_tree(tmp_path_factory.mktemp("real") / "nuscenes")


@pytest.fixture
def own(root, tmp_path):
    """A copy that a test may damage."""
    return shutil.copytree(root, tmp_path / "own")


def score(run, *overrides):
    with initialize_config_dir(str(CONFIGS), version_base="1.3"):
        evaluate_run(compose("eval", overrides=[f"run={run}", "bootstrap=3", *overrides]))
    newest = max(run.rglob("drop_table.json"), key=lambda path: path.stat().st_mtime_ns)
    return json.loads(newest.read_bytes())


# The official lists.


def test_the_official_lists_are_whole_and_apart():
    splits = official_splits()
    counts = {"mini_train": 8, "mini_val": 2, "train": 700, "val": 150, "test": 150}
    assert {name: len(scenes) for name, scenes in splits.items()} == counts
    assert len({*splits["train"], *splits["val"], *splits["test"]}) == 1000
    assert {*splits["mini_train"], *splits["mini_val"]} <= {*splits["train"], *splits["val"]}
    assert {name for names in OFFICIAL.values() for name in names} == counts.keys()


@pytest.mark.parametrize(
    ("version", "split", "scenes"),
    [
        ("v1.0-mini", "train", SCENES[:3]),
        ("v1.0-mini", "mini_val", SCENES[3:]),
        ("v1.0-trainval", "train", (SCENES[0], SCENES[2])),
        ("v1.0-trainval", "val", (SCENES[3], SCENES[1])),
        ("v1.0-test", "test", ("scene-0077",)),
    ],
)
def test_the_version_chooses_the_official_lists(own, version, split, scenes):
    if version == "v1.0-test":
        edit(own, "scene", lambda s: s.update(name="scene-0077") if s["name"] == SCENES[0] else None, "v1.0-mini")
    (own / "v1.0-mini").rename(own / version)
    tree = NuScenes(own)
    assert tuple(dict.fromkeys(tree.scene(token)["name"] for token in tree.split(split))) == scenes


def test_a_splits_file_goes_before_the_official_lists(own):
    (own / "v1.0-mini/splits.json").write_text('{"mine": ["scene-0103"]}')
    assert set(NuScenes(own).splits) == {"mine", "all"}


@pytest.mark.parametrize("text", ["[]", '{"val": "scene-0103"}', '{"val": [3]}', '{"val": null}', '{"val"'])
def test_a_splits_file_of_another_kind_is_named(own, text):
    (own / "v1.0-mini/splits.json").write_text(text)
    with pytest.raises(ValueError, match=r"splits\.json"):
        NuScenes(own).split("val")


# Versions.


def test_of_two_versions_one_is_chosen_and_not_guessed(own):
    shutil.copytree(own / "v1.0-mini", own / "v1.0-trainval")
    with pytest.raises(ValueError, match=r"has the versions v1\.0-mini, v1\.0-trainval; choose one.*data\.version="):
        NuScenes(own)
    assert NuScenes(own, "v1.0-mini").folder.name == "v1.0-mini"
    with pytest.raises(ValueError, match=r"has no version v1\.0-test; it has v1\.0-mini, v1\.0-trainval"):
        NuScenes(own, "v1.0-test")


def test_a_version_chooses_in_a_list_only_where_there_are_several(own, tmp_path):
    shutil.copytree(own / "v1.0-mini", own / "v1.0-trainval")
    other = write_tree(tmp_path / "other", scenes=1, keyframes=1)
    found = open_datasets([str(own), str(other)], "v1.0-trainval")
    assert [tree.folder.name for tree in found] == ["v1.0-trainval", "v1.0-tiny"]


def test_a_folder_of_an_archive_is_no_version(own):
    (own / "v1.0-trainval01_blobs").mkdir()
    assert NuScenes(own).folder.name == "v1.0-mini"


def test_the_folder_of_tables_given_as_the_root_is_told_apart(own):
    with pytest.raises(ValueError, match=rf"give the folder above: {own}$"):
        NuScenes(own / "v1.0-mini")


# Images.


@pytest.mark.parametrize(
    ("source", "stride", "size"),
    [
        ((900, 1600), 8, (392, 704)),
        ((900, 1600), 4, (396, 704)),
        ((128, 352), 8, (128, 352)),
        ((90, 160), 8, (88, 160)),
        ((1024, 1224), 8, (584, 704)),
        ((900, 1600), None, (900, 1600)),
    ],
)
def test_an_image_of_any_size_fits_by_default_and_keeps_its_aspect(source, stride, size):
    fit = fit_image(source, None, stride)
    assert (fit.height, fit.width) == size
    assert fit.width / source[1] == pytest.approx(fit.scaled_height / source[0], abs=0.002)
    assert fit.scaled_height - fit.height < (stride or 1)


@pytest.mark.parametrize(
    ("size", "message"),
    [
        ([400, 700], r"not in whole cells of 8 pixels .*; use \[400, 696\]"),
        ([3, 704], r"use \[8, 704\]"),
        ([704], r"not \[height, width\]"),
        ([0, 704], r"not \[height, width\]"),
        ([160, 160], r"taller than the image of 90x160 at that width; use at most \[88, 160\]"),
    ],
)
def test_a_size_that_does_not_fit_is_answered_with_one_that_does(root, size, message):
    tree = NuScenes(root)
    with pytest.raises(ValueError, match=message):
        SampleReader(image_size=size).read(tree, tree.split("val")[0])


def test_the_size_that_is_advised_is_taken(root):
    tree = NuScenes(root)
    for size in ([88, 160], [8, 16]):
        sample = SampleReader(image_size=size).read(tree, tree.split("val")[0])
        assert sample.images.shape[1:3] == tuple(size)
        assert sample.lidar_depth.shape[1:] == (size[0] // 8, size[1] // 8)


# Training and scoring.


def test_it_is_trained_on_and_scored(root, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run = fit(settings(root, *STEPS, "depth_supervision=lidar"))
    table = score(run)
    assert (table["num_samples"], len(table["rows"])) == (3, 7)
    assert table["rows"][0]["num_gt"]["car"] == 3
    assert "decoys" not in table


def test_a_run_knows_its_version(own, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copytree(own / "v1.0-mini", own / "v1.0-trainval")
    run = fit(settings(own, *STEPS, "depth_supervision=lidar", "data.version=v1.0-trainval"))
    assert score(run)["num_samples"] == 6  # of val; mini_val has half of them
    assert score(run, "data.version=v1.0-mini")["num_samples"] == 3
    assert score(run, f"data.root={own}")["num_samples"] == 6  # the same data by name
    other = shutil.copytree(own, tmp_path / "other")
    with pytest.raises(ValueError, match="choose one"):
        score(run, f"data.root={other}")


@pytest.mark.parametrize(("encoders", "unused"), [("[lidar]", ("CAM", "RADAR")), ("[radar]", ("CAM", "LIDAR"))])
def test_files_of_sensors_without_an_encoder_are_not_needed(own, tmp_path, monkeypatch, encoders, unused):
    monkeypatch.chdir(tmp_path)
    for path in own.glob("s*s/*/*"):
        if path.parent.name.startswith(unused):
            path.unlink()
    run = fit(settings(own, *STEPS, f"encoders={encoders}"))
    assert len(score(run)["rows"]) == 7
    assert [*run.rglob("pictures.png")]


def test_the_overlay_and_the_statistics_take_a_version(own, tmp_path):
    shutil.copytree(own / "v1.0-mini", own / "v1.0-trainval")
    write_check(str(own), version="v1.0-mini", split="val", out=str(tmp_path / "check.png"))
    write_statistics(str(own), version="v1.0-mini", split="train", out=str(tmp_path))
    assert json.loads((tmp_path / "statistics.json").read_bytes())["image_size"] == [160, 90]


def test_a_track_ends_where_its_next_label_is_not_in_the_table(own):
    whole = NuScenes(own)
    first, second, third = (t for t in whole.split("val"))
    edit(own, "sample_annotation", lambda label: label["sample_token"] != first, "v1.0-mini")
    cut = NuScenes(own)
    assert not len(cut.annotations(first, ["car"]))
    before, after = (tree.annotations(second, ["car"]).boxes for tree in (whole, cut))
    center = [whole.annotations(token, ["car"]).boxes.center[0, :2] for token in (second, third)]
    np.testing.assert_allclose(after.velocity[0], (center[1] - center[0]) / 0.5)
    np.testing.assert_allclose(after.center, before.center)


def test_what_was_not_generated_is_extracted_again(own):
    (own / "v1.0-mini/sample.json").write_text("[{")
    with pytest.raises(ValueError, match=r"extract the archives .* again$") as error:
        NuScenes(own)
    assert "generate it" not in str(error.value)
    (own / "manifest.json").write_text('{"hash": "a", "command": "python -m data_gen data=nano"}')
    with pytest.raises(
        ValueError, match=r"delete .* and generate it again: python -m data_gen data=nano data.root=\S+$"
    ):
        NuScenes(own)


def test_the_same_version_twice_is_the_same_data(own):
    with pytest.raises(ValueError, match=r"hold the same samples, of scene-0061: leave one out$"):
        samples_of_split(open_datasets([str(own), str(own)]), "train")
