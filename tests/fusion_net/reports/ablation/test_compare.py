"""Variants compared: what is paired, what is missing, and how wide an interval is."""

import numpy as np
import pytest

from fusion_net.reports.ablation.compare import compare, two_level
from fusion_net.reports.ablation.jobs import Job
from tests.fixtures.run_results import RESAMPLES, make_result

SCENES = np.random.default_rng(1).normal(0, 0.03, RESAMPLES)
"""What the choice of scenes does to every run alike."""


def job(variant, seed, score=None, *, place=0, why="not finished", **more):
    overrides = (variant, f"seed={seed}")
    result = None
    if score is not None:
        result = make_result(score, seed=seed, overrides=(variant,), job=place, noise=SCENES, **more)
    return Job("_".join(overrides), overrides, place, result, "" if result else why)


def sweep(scores, **more):
    """Jobs of ``{variant: [score of seed 1, 2, ...]}``."""
    return [
        job(variant, seed, score, place=10 * place + seed, **more)
        for place, (variant, row) in enumerate(scores.items())
        for seed, score in enumerate(row, start=1)
    ]


def by_label(doc):
    return {variant["label"]: variant for variant in doc["variants"]}


def test_means_and_spread_are_over_seeds_in_the_order_of_the_sweep():
    doc = compare(sweep({"p=0": [0.5, 0.52, 0.54], "p=1": [0.6, 0.6, 0.6]}))
    assert [variant["label"] for variant in doc["variants"]] == ["p=0", "p=1"]
    first = doc["variants"][0]
    assert first["mAP"]["C+L+R"]["mean"] == pytest.approx(0.52)
    assert first["mAP"]["C+L+R"]["sd"] == pytest.approx(0.02)
    assert first["mAP"]["R"]["mean"] == pytest.approx(0.52 - 6 * 0.05)
    assert first["n"] == 3
    assert first["minutes"]["mean"] == pytest.approx(4.02)
    assert first["mAVE"]["mean"] is None


def test_a_difference_is_paired_by_scenes_and_seeds():
    """Scenes shift all runs alike and seeds shift both variants alike: neither blurs the difference."""
    doc = compare(sweep({"p=0": [0.50, 0.54, 0.58], "p=1": [0.51, 0.55, 0.59]}))
    difference = by_label(doc)["p=1"]["difference"]["C+L+R"]
    assert difference["mean"] == pytest.approx(0.01)
    low, high = difference["ci95"]
    assert high - low < 1e-3
    low, high = by_label(doc)["p=1"]["mAP"]["C+L+R"]["ci95"]
    assert high - low > 0.1
    assert by_label(doc)["p=0"]["difference"] == {}


def test_an_interval_grows_with_the_spread_of_seeds():
    widths = []
    for spread in (0.0, 0.02, 0.06):
        doc = compare(sweep({"p=0": [0.5, 0.5, 0.5], "p=1": [0.5 - spread, 0.5, 0.5 + spread]}))
        low, high = by_label(doc)["p=1"]["difference"]["C"]["ci95"]
        widths.append(high - low)
    assert widths[0] < 1e-3 < widths[1] < widths[2]


def test_a_seed_without_a_result_is_named_and_in_no_figure():
    jobs = sweep({"p=0": [0.5, 0.6, 0.7], "p=1": [0.5, None, 0.7], "p=2": [0.5, 0.5]})
    doc = compare(jobs)
    lame, short = by_label(doc)["p=1"], by_label(doc)["p=2"]
    assert lame["missing"] == {"2": "p=1_seed=2: not finished"}
    assert lame["n"] == 2
    assert lame["mAP"]["C+L+R"]["values"] == [0.5, 0.7]
    assert lame["difference"]["C+L+R"]["n"] == 2
    assert lame["difference"]["C+L+R"]["mean"] == pytest.approx(0.0)
    assert short["missing"] == {"3": "no such job"}


def test_a_variant_without_any_result_stays_in_the_table():
    doc = compare(sweep({"p=0": [0.5], "p=1": [None]}))
    assert by_label(doc)["p=1"]["n"] == 0
    assert by_label(doc)["p=1"]["mAP"] == {}
    with pytest.raises(ValueError, match="no job has a result yet; 1 are without, such as p=1_seed=1: not begun"):
        compare([job("p=1", 1, why="not begun")])


def test_a_specialist_is_compared_on_the_row_of_its_own_sensors():
    jobs = [
        job("encoders=[all]", 1, 0.6),
        job("encoders=[camera,radar]", 1, 0.7, place=1, encoders=("camera", "radar")),
    ]
    special = by_label(compare(jobs))["encoders=[camera,radar]"]
    assert list(special["mAP"]) == ["C+R"]
    assert list(special["difference"]) == ["C+R"]
    assert special["difference"]["C+R"]["mean"] == pytest.approx(0.1)
    assert special["sensors"] == "C+R"


def test_the_reference_is_named_by_a_part_of_its_label():
    jobs = sweep({"p=0": [0.5], "p=0.3": [0.6], "q=0.3": [0.7]})
    assert compare(jobs, reference="p=0")["reference"] == "p=0"
    assert by_label(compare(jobs, reference="q"))["p=0"]["difference"]["C"]["mean"] == pytest.approx(-0.2)
    with pytest.raises(
        ValueError, match=r"reference=0\.3 is in the names of 2 variants; write more of one of: p=0\.3; q=0\.3"
    ):
        compare(jobs, reference="0.3")


def test_what_all_jobs_were_told_is_not_part_of_their_names():
    jobs = [
        Job(f"{p}{seed}", ("trainer=short", f"p={p}", f"seed={seed}"), p, make_result(0.5, seed=seed))
        for p in (1, 2)
        for seed in (1, 2)
    ]
    doc = compare(jobs)
    assert [variant["label"] for variant in doc["variants"]] == ["p=1", "p=2"]
    assert doc["shared"] == ["trainer=short"]


def test_scores_on_other_data_are_refused_and_other_recipes_named():
    other = job("p=1", 1, 0.6)
    other.result["scored"] |= {"data": ["e" * 64]}
    with pytest.raises(
        ValueError, match=r"p=0_seed=1 was scored on 320 samples of val of ffffffffffff.*cannot be compared"
    ):
        compare([job("p=0", 1, 0.5), other])
    recipes = [{"trainer.fusion_steps": 1200, "p": 0}, {"trainer.fusion_steps": 1500, "p": 1}]
    jobs = [job(f"p={i}", 1, 0.5, settings=settings) for i, settings in enumerate(recipes)]
    assert compare(jobs)["beside"] == {"trainer.fusion_steps": ["1200", "1500"]}
    deep = [{"model.encoders.camera.stride": stride, "trainer.max_lr": stride / 1e3} for stride in (4, 8)]
    jobs = [job(f"view_transform={i}", 1, 0.5, settings=settings) for i, settings in enumerate(deep)]
    assert compare(jobs)["beside"] == {"trainer.max_lr": ["0.004", "0.008"]}


def test_two_levels_have_the_variance_of_a_mean_over_seeds_and_that_of_the_scenes():
    rng = np.random.default_rng(0)
    seeds, scenes = rng.normal(0, 0.04, (5, 1)), rng.normal(0, 0.02, (1, 5000))
    draws = two_level(seeds + scenes, np.random.default_rng(1), draws=20000)
    expected = seeds.var(ddof=1) / 5 + scenes.var()
    assert draws.var() == pytest.approx(expected, rel=0.05)
    assert draws.mean() == pytest.approx((seeds + scenes).mean(), abs=1e-3)
    assert two_level(scenes, np.random.default_rng(1), draws=20000).var() == pytest.approx(scenes.var(), rel=0.05)
