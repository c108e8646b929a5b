"""The jobs of a sweep: those that ran, those that are committed, those that are missing; and the pages made of them."""

import json

import cv2
import pytest
from omegaconf import OmegaConf

from fusion_net.reports.ablation.jobs import collect, find_jobs
from fusion_net.reports.ablation.write import write_ablation
from fusion_net.reports.run_result import read_result, write_result
from tests.fixtures.run_results import make_result


def write_job(sweep, p, seed, score=None, *, place=0, finished=True):
    """The folder of a job, with a result if it has a score."""
    folder = sweep / f"p-{p}_seed-{seed}"
    folder.mkdir(parents=True)
    (folder / "config.yaml").write_text("seed: 1\n")
    around = {"overrides": [f"p={p}", f"seed={seed}"], "job": place, "finished": finished}
    (folder / "env.json").write_text(json.dumps(around))
    if score is not None:
        result = make_result(score, seed=seed, overrides=(f"p={p}",), job=place)
        write_result(folder / "eval/result.json", result)
    return folder


def note_command(sweep, params, *overrides):
    """What Hydra writes before the first job."""
    left_out = {"job": {"config": {"override_dirname": {"exclude_keys": ["sweep", "data.root"]}}}}
    hydra = {"sweeper": {"params": params}, "overrides": {"task": ["+sweep=x", "data.root=d", *overrides]}} | left_out
    OmegaConf.save(OmegaConf.create({"hydra": hydra}), sweep / "multirun.yaml")


@pytest.fixture
def sweep(tmp_path):
    """Of p = 10 and 2 with two seeds each: one job is interrupted, one is not scored, one was never begun."""
    folder = tmp_path / "runs/sweeps/x"
    write_job(folder, 10, 1, 0.5, place=0)
    write_job(folder, 10, 2, place=1, finished=False)
    (folder / "p-10_seed-2/checkpoints").mkdir()
    (folder / "p-10_seed-2/checkpoints/last.ckpt").touch()
    write_job(folder, 2, 1, place=2)
    note_command(folder, {"p": "10,2", "seed": "1,2"})
    return folder


def test_every_job_is_found_in_the_order_of_the_sweep_and_says_what_it_lacks(sweep, tmp_path):
    jobs = find_jobs(sweep, tmp_path / "none")
    assert [job.name for job in jobs] == ["p-10_seed-1", "p-10_seed-2", "p-2_seed-1", "p-2_seed-2"]
    assert [job.seed for job in jobs] == [1, 2, 1, 2]
    assert [job.variant for job in jobs] == [("p=10",), ("p=10",), ("p=2",), ("p=2",)]
    assert jobs[0].result["rows"][0]["mAP"] == 0.5
    assert jobs[1].why == "not finished"
    assert jobs[2].why.startswith("not scored; python eval.py")
    assert jobs[3].why == "not begun"


def test_committed_results_count_as_much_and_later_jobs_add_to_them(sweep, tmp_path):
    committed = tmp_path / "docs/x"
    assert collect(find_jobs(sweep, committed), committed) == ["p-10_seed-1"]
    assert collect(find_jobs(sweep, committed), committed) == []
    write_result(committed / "p-2_seed-2.json", make_result(0.7, seed=2, overrides=("p=2",), job=3))
    elsewhere = tmp_path / "runs/elsewhere/x"
    write_job(elsewhere, 2, 1, 0.6, place=2)
    jobs = find_jobs(elsewhere, committed)
    assert {job.name: job.result["rows"][0]["mAP"] for job in jobs} == {
        "p-10_seed-1": 0.5, "p-2_seed-1": 0.6, "p-2_seed-2": 0.7
    }  # fmt: skip
    assert all(read_result(path) for path in committed.glob("*.json"))


def test_a_damaged_result_is_named_and_the_others_make_the_table(sweep, tmp_path):
    results = tmp_path / "results"
    write_job(sweep, 2, 2, 0.6, place=3)
    write_result(results / "x/p-2_seed-2.json", make_result(0.4, seed=2, overrides=("p=2",), job=3))
    (sweep / "p-2_seed-2/eval/result.json").write_text("{")
    (results / "x/p-10_seed-1.json").write_text("{}")
    (results / "x/p-3_seed-1.json").write_text("[]")
    jobs = {job.name: job for job in find_jobs(sweep, results / "x")}
    assert jobs["p-10_seed-1"].result["rows"][0]["mAP"] == 0.5
    assert jobs["p-2_seed-2"].result["rows"][0]["mAP"] == 0.4  # the committed one
    assert jobs["p-3_seed-1"].result is None
    assert "git checkout -- " in jobs["p-3_seed-1"].why
    write_ablation(sweep, results=results, pages=tmp_path / "pages", keep=True)
    page = (tmp_path / "pages/x/ablation.md").read_text()
    assert "p-3_seed-1.json is no result of a run (" in page
    assert "| p=10 | 0.500 |" in page
    assert read_result(results / "x/p-10_seed-1.json")["rows"][0]["mAP"] == 0.5  # written anew


def test_a_folder_without_jobs_is_told_how_to_get_some(tmp_path):
    with pytest.raises(
        FileNotFoundError, match=r"no job of a sweep in .*; run one: .* \+sweep=NAME, NAME one of .*levels"
    ):
        find_jobs(tmp_path / "x", tmp_path / "y")
    with pytest.raises(
        FileNotFoundError, match=r"no job of a sweep in .*; run one: python train\.py -m \+sweep=levels$"
    ):
        find_jobs(tmp_path / "levles", tmp_path / "y")


def test_pages_name_the_missing_and_the_chart_can_be_opened(sweep, tmp_path, capsys):
    write_job(sweep, 2, 2, 0.6, place=3)
    target = write_ablation(sweep, results=tmp_path / "results", pages=tmp_path / "pages")
    assert target == sweep
    page = (target / "ablation.md").read_text()
    assert "| p=10 | 0.500 |" in page
    assert "* p=10, seed 2: p-10_seed-2: not finished" in page
    assert "* p=2, seed 1: p-2_seed-1: not scored" in page
    assert "p=10, seed 2" in capsys.readouterr().out
    doc = json.loads((target / "ablation.json").read_text())
    assert [variant["n"] for variant in doc["variants"]] == [1, 1]
    assert cv2.imread(str(target / "ablation.png")).std() > 10
    for block in page.split("\n\n"):
        if block.startswith("|"):
            assert len({line.count("|") for line in block.splitlines()}) == 1


def test_collecting_puts_results_and_page_where_they_are_committed(sweep, tmp_path):
    results, pages = tmp_path / "docs/results/runs", tmp_path / "docs/results"
    target = write_ablation(sweep, results=results, pages=pages, keep=True)
    assert target == pages / "x"
    assert sorted(path.name for path in target.iterdir()) == ["ablation.json", "ablation.md", "ablation.png"]
    assert [path.name for path in (results / "x").iterdir()] == ["p-10_seed-1.json"]
    assert not (sweep / "ablation.md").exists()
    with pytest.raises(ValueError, match="collect=true needs the folder"):
        write_ablation(sweep, results=None, pages=pages, keep=True)
