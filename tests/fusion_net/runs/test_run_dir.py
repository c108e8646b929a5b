from pathlib import Path

import pytest
import torch
from omegaconf import OmegaConf

from fusion_net.common.atomic import replacing
from fusion_net.runs.checkpoints import load_weights, resume_step
from fusion_net.runs.run_dir import (
    cut_short,
    is_finished,
    load_config,
    mark_finished,
    open_run,
    refuse_other_data,
    run_folder,
    surroundings,
)

CONFIG = OmegaConf.create(
    {
        "model": {"width": 8},
        "encoders": ["camera"],
        "fuser": "concat",
        "grid": {"cell": 0.8},
        "seed": 1,
        "data": {"root": "here"},
        "trainer": {"devices": 1, "batch_size": 8},
    }
)


def test_a_run_that_exists_is_not_overwritten(tmp_path):
    folder = open_run(tmp_path / "a", CONFIG, resume=False, overwrite=False)
    assert load_config(folder).seed == 1
    assert (folder / "env.json").exists()
    with pytest.raises(ValueError, match="resume=true"):
        open_run(folder, CONFIG, resume=False, overwrite=False)


def test_settings_from_before_the_losses_knew_the_grid_are_read_as_those_of_now(tmp_path):
    grid = {"x_min": 0.0, "cell": 0.8}
    part = {"grid": grid, "losses": {"cell": 0.8, "peak_radius": 3}}
    (tmp_path / "config.yaml").write_text(OmegaConf.to_yaml({"model": part | {"detectors": {"lidar": part}}}))
    model = load_config(tmp_path).model
    for losses in (model.losses, model.detectors.lidar.losses):
        assert losses == {"peak_radius": 3, "grid": grid}


def test_a_file_in_the_place_of_the_folder_is_named(tmp_path):
    (tmp_path / "a").write_text("notes")
    with pytest.raises(ValueError, match="is a file"):
        open_run(tmp_path / "a", CONFIG, resume=False, overwrite=True)
    assert (tmp_path / "a").read_text() == "notes"


def test_resume_needs_a_run_of_the_same_model(tmp_path):
    with pytest.raises(ValueError, match="nothing to resume"):
        open_run(tmp_path / "a", CONFIG, resume=True, overwrite=False)
    assert not (tmp_path / "a").exists()
    folder = open_run(tmp_path / "a", CONFIG, resume=False, overwrite=False)
    (folder / "checkpoints" / "last.ckpt").write_bytes(b"x")
    (folder / "metrics.csv").write_text("rows")
    open_run(folder, OmegaConf.merge(CONFIG, {"data": {"root": "moved"}}), resume=True, overwrite=False)
    assert (folder / "metrics.csv").read_text() == "rows"
    kept = (folder / "config.yaml").read_text()
    with pytest.raises(
        ValueError, match=r"other settings \(model.width: .* there, 9 asked for\); resume with the same"
    ):
        open_run(folder, OmegaConf.merge(CONFIG, {"model": {"width": 9}}), resume=True, overwrite=False)
    with pytest.raises(ValueError, match=r"other settings \(seed: 1 there, 2 asked for\)"):
        open_run(folder, OmegaConf.merge(CONFIG, {"seed": 2}), resume=True, overwrite=False)
    assert (folder / "config.yaml").read_text() == kept


def test_other_devices_resume_a_run_with_the_samples_of_its_steps(tmp_path):
    def with_devices(devices, batch_size):
        return OmegaConf.merge(CONFIG, {"trainer": {"devices": devices, "batch_size": batch_size}})

    def resumed(cfg, devices):
        return open_run(folder, cfg, resume=True, overwrite=False, devices=devices)

    folder = open_run(tmp_path / "a", with_devices(-1, 4), resume=False, overwrite=False, devices=2)
    begun = (folder / "config.yaml").read_text()
    with pytest.raises(ValueError, match=r"takes 8 samples a step, .*=4 on 1 .* is 4; write trainer\.batch_size=8$"):
        resumed(with_devices(1, 4), 1)
    with pytest.raises(ValueError, match=r"is 16; write trainer\.batch_size=4$"):
        resumed(with_devices(2, 8), 2)
    with pytest.raises(ValueError, match=r"is 12; write trainer\.devices=2 trainer\.batch_size=4$"):
        resumed(with_devices(3, 4), 3)
    assert (folder / "config.yaml").read_text() == begun
    resumed(with_devices(1, 8), 1)
    resumed(with_devices(-1, 2), 4)
    (folder / "env.json").unlink()  # as of a run from before it said how many
    resumed(with_devices(1, 2), 1)


def test_a_run_cut_before_its_first_checkpoint_starts_again(tmp_path):
    folder = open_run(tmp_path / "a", CONFIG, resume=False, overwrite=False)
    (folder / "metrics.csv").write_text("rows of the first try")
    open_run(folder, CONFIG, resume=True, overwrite=False)
    assert not (folder / "metrics.csv").exists()


def test_a_file_is_replaced_whole_or_not_at_all(tmp_path):
    path = tmp_path / "last.ckpt"
    path.write_text("old")

    def write_half():
        with replacing(path) as file:
            file.write(b"half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_half()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
    with replacing(path) as file:
        file.write(b"new")
        assert path.read_text() == "old"
    assert path.read_text() == "new"


def test_a_missing_run_lists_those_there_are(tmp_path):
    open_run(tmp_path / "baseline", CONFIG, resume=False, overwrite=False)
    with pytest.raises(FileNotFoundError, match=r"did you mean .*/baseline\?"):
        load_config(tmp_path / "basline")


def test_weights_come_back_and_foreign_ones_are_refused(tmp_path):
    model = torch.nn.Linear(3, 2)
    path = tmp_path / "a.ckpt"
    torch.save({"state_dict": {f"model.{k}": v for k, v in model.state_dict().items()}}, path)
    other = torch.nn.Linear(3, 2)
    load_weights(other, path)
    assert torch.equal(other.weight, model.weight)
    with pytest.raises(ValueError, match="another model: 2 tensors differ, the first is 'weight'"):
        load_weights(torch.nn.Linear(4, 5), path)
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(ValueError, match="not a readable checkpoint"):
        load_weights(other, path)
    with pytest.raises(FileNotFoundError, match=r"there are a\.ckpt"):
        load_weights(other, tmp_path / "b.ckpt")


def test_data_made_with_other_settings_is_refused(tmp_path):
    folder = open_run(tmp_path / "a", CONFIG, resume=False, overwrite=False, data={"a" * 64: ""})
    refuse_other_data(folder, ["a" * 64])
    with pytest.raises(ValueError, match=r"manifest aaaaaaaaaaaa, now bbbbbbbbbbbb"):
        refuse_other_data(folder, ["b" * 64])
    (folder / "checkpoints" / "last.ckpt").write_bytes(b"x")
    with pytest.raises(ValueError, match="no longer that which"):
        open_run(folder, CONFIG, resume=True, overwrite=False, data={"b" * 64: ""})
    assert "aaaa" in (folder / "env.json").read_text()


def test_a_checkpoint_is_looked_at_before_a_run_goes_on(tmp_path):
    model, path = torch.nn.Linear(3, 2), tmp_path / "last.ckpt"
    state = {f"model.{k}": v for k, v in model.state_dict().items()}
    torch.save({"state_dict": state, "global_step": 7}, path)
    assert resume_step(model, path) == 7
    with pytest.raises(ValueError, match="another model"):
        resume_step(torch.nn.Linear(4, 5), path)
    path.write_bytes(b"x")
    with pytest.raises(ValueError, match="not a readable checkpoint"):
        resume_step(model, path)


def test_a_run_is_finished_once_it_says_so_and_only_for_its_own_settings(tmp_path):
    assert not is_finished(tmp_path / "a", CONFIG)
    folder = open_run(tmp_path / "a", CONFIG, resume=False, overwrite=False, data={"d": ""})
    assert not is_finished(folder, CONFIG)
    mark_finished(folder, steps=5, planned=5)
    assert is_finished(folder, OmegaConf.merge(CONFIG, {"resume": True, "skip_finished": True, "name": "a"}))
    refuse_other_data(folder, ["d"])
    with pytest.raises(ValueError, match=r"a is a run with other settings \(seed: 1 there, 2 asked for\)"):
        is_finished(folder, OmegaConf.merge(CONFIG, {"seed": 2}))
    open_run(folder, CONFIG, resume=False, overwrite=True)
    assert not is_finished(folder, CONFIG)


def test_how_much_is_watched_is_no_setting_of_the_result(tmp_path):
    """Runs from before there was a choice count too."""
    before = OmegaConf.merge(CONFIG, {"trainer": {"batch_size": 8}})
    folder = open_run(tmp_path / "a", before, resume=False, overwrite=False)
    mark_finished(folder, steps=5, planned=5)
    assert is_finished(folder, OmegaConf.merge(before, {"trainer": {"drop_table_at_validation": True}}))


def test_a_run_that_time_cut_short_says_so(tmp_path):
    folder = open_run(tmp_path / "a", CONFIG, resume=False, overwrite=False)
    assert cut_short(surroundings(folder)) == ""
    mark_finished(folder, steps=5, planned=5)
    assert cut_short(surroundings(folder)) == ""
    mark_finished(folder, steps=3, planned=5)
    assert "after 3 of its 5 steps" in cut_short(surroundings(folder))


@pytest.mark.parametrize(
    ("name", "text"), [("config.yaml", "seed: ["), ("config.yaml", "[1]"), ("config.yaml", ""), ("env.json", '{"da')]
)
def test_damaged_settings_are_named(tmp_path, name, text):
    folder = open_run(tmp_path / "a", CONFIG, resume=False, overwrite=False)
    (folder / name).write_text(text)
    with pytest.raises(ValueError, match=f"{name} (is damaged|holds no settings)"):
        is_finished(folder, CONFIG)


@pytest.mark.parametrize(
    "name",
    ["", " ", ".", "..", "a/../b", "/abs", "a//b", "a/", "./a", "runs/a", "a\nb", "x" * 300, "study/" + "x" * 300],
)
def test_a_name_is_a_folder_below_runs(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=r"^name="):
        run_folder(name)


def test_a_name_may_hold_folders_but_not_a_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run_folder("study/a b=ü") == Path("runs/study/a b=ü")
    open_run(run_folder("mine"), CONFIG, resume=False, overwrite=False)
    with pytest.raises(ValueError, match="lies within the run runs/mine"):
        run_folder("mine/eval")
