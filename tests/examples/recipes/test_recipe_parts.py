"""The parts that the recipes add: an encoder, a fuser, a road. What their pages say to test is tested here."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hydra import compose, initialize_config_dir

from data_gen.road.layout import record_layout
from fusion_net.common.cli.command import CONFIGS, build
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.common.settings import own_object
from fusion_net.models.fuser import make_fuser
from tests.fixtures.small_model import CHANNELS, GRID, small_batch, small_model

RECIPES = Path(__file__).resolve().parents[3] / "examples" / "recipes"


@pytest.fixture(autouse=True)
def modules(monkeypatch):
    monkeypatch.syspath_prepend(str(RECIPES))
    yield
    for path in RECIPES.glob("*.py"):
        sys.modules.pop(path.stem, None)


def composed(command, *overrides):
    search = f"hydra.searchpath=[file://{RECIPES}]"
    with initialize_config_dir(str(CONFIGS), version_base="1.3"):
        return compose(command, overrides=[search, *overrides])


def slices():
    edges = composed("train", "lidar_encoder=height_slices").model.encoders.lidar.edges
    return own_object("height_slices.HeightSlices", where="test")(
        grid=GRID, channels=CHANNELS, edges=list(edges)
    ).eval()


def with_points(points):
    """A batch of one sample with these LiDAR points (P, 5)."""
    return replace(small_batch(size=1), lidar_points=points, lidar_batch=torch.zeros(len(points), dtype=torch.int64))


@torch.no_grad()
def test_a_batch_gives_what_its_samples_give_one_by_one():
    batch, encoder = small_batch(), slices()
    together = encoder(batch).bev
    assert together.shape == (batch.size, CHANNELS, *GRID.shape)
    for i in range(batch.size):
        alone = with_points(batch.lidar_points[batch.lidar_batch == i])
        torch.testing.assert_close(encoder(alone).bev[0], together[i])


@torch.no_grad()
def test_an_empty_cloud_gives_a_finite_map_and_a_point_moves_the_cells_around_it():
    clouds, encoder = (torch.zeros(0, 5), torch.tensor([[10.0, 4.0, 0.9, 0.5, 0.0]])), slices()
    nothing, point = (encoder(with_points(cloud)).bev for cloud in clouds)
    assert nothing.isfinite().all()
    rows, columns = ((point - nothing).abs().sum(1)[0] > 0).nonzero().T
    row, column, _ = GRID.rows_columns(torch.tensor([10.0, 4.0]))
    assert len(rows)
    assert (rows - row).abs().max() <= 2  # two 3x3 convolutions
    assert (columns - column).abs().max() <= 2


def test_a_model_takes_the_encoder_and_a_fuser_by_its_name():
    cfg = composed("train", "lidar_encoder=height_slices", "fuser=max_fuser.MaxFuser")
    model = build(cfg.model, "model")
    early = build(composed("train", "model=early", "fuser=max_fuser.MaxFuser").model, "model")
    assert type(model.encoders["lidar"]).__name__ == "HeightSlices"
    assert {type(each.fuser).__name__ for each in (model, early)} == {"MaxFuser"}


@pytest.mark.parametrize("training", [True, False])
def test_what_an_absent_sensor_holds_does_not_pass_the_fuser(training):
    fuser = make_fuser("max_fuser.MaxFuser", modalities=list(MODALITIES), channels=8).train(training)
    maps = {name: torch.rand(2, 8, 4, 6) for name in MODALITIES}
    present = torch.tensor([[True, True, True], [True, False, True]])
    changed = maps | {"lidar": maps["lidar"].clone()}
    changed["lidar"][1] = torch.nan
    assert torch.equal(fuser(maps, present), fuser(changed, present))


def test_an_untrained_model_with_it_finds_finite_boxes_whatever_is_missing():
    model = small_model(fuser="max_fuser.MaxFuser").eval()
    for present in ([True, False, False], [False, False, False]):
        with torch.no_grad():
            maps = model(small_batch(size=1), torch.tensor([present])).maps
        assert all(each.isfinite().all() for each in maps.values())


def test_a_module_that_is_not_found_is_one_line_that_says_where_modules_are_looked_for():
    with pytest.raises(ValueError, match=r"fuser=nowhere.Fuser cannot be imported: .*'nowhere'; modules .*PYTHONPATH"):
        make_fuser("nowhere.Fuser", modalities=["lidar"], channels=8)
    with pytest.raises(ValueError, match=r"unknown fuser 'conct'; did you mean 'concat'\?"):
        make_fuser("conct", modalities=["lidar"], channels=8)


def test_the_winding_road_is_driven_and_nobody_turns_round():
    scenario = build(composed("data_gen", "scenario=country").scenario, "scenario")
    drawn = [scenario.sample_layout("train", seed=seed) for seed in range(200)]
    assert 60 < drawn.count("winding") < 140
    for seed in range(4):
        street = scenario.all_streets["winding"]
        layout = record_layout("winding", seed=seed, duration=4.0, traffic=scenario.traffic, street=street)
        assert layout.vehicles
        assert all(np.ptp(track.yaw) < 1.0 for track in (layout.ego, *layout.vehicles))
        assert len({lane.left_line for lane in layout.lanes}) == 2


def test_the_conditions_are_what_they_say():
    mix = build(composed("data_gen", "condition=clear_or_drizzle").condition, "condition")
    drawn = [mix.sample(np.random.default_rng(seed), heading=0.0) for seed in range(60)]
    wet = [each for each in drawn if each.name == "drizzle_night"]
    assert 10 < len(wet) < 32
    assert all(each.is_night and each.rain_rate >= 0.5 and each.water_film > 0 for each in wet)


def test_the_rig_has_two_cameras_and_no_radar():
    rig = build(composed("data_gen", "rig=two_cameras").rig, "rig")
    assert list(rig.cameras) == ["CAM_FRONT", "CAM_BACK"]
    assert not rig.radars
