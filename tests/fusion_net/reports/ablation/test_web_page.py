"""The comparison of variants as a page: every variant, what is missing, nothing from anywhere else."""

from fusion_net.reports.ablation.compare import compare
from fusion_net.reports.ablation.jobs import Job
from fusion_net.reports.ablation.pages import as_markdown
from fusion_net.reports.ablation.web_page import as_html
from tests.fixtures.html_page import Page
from tests.fixtures.run_results import make_result


def job(variant, seed, score=None):
    overrides = (variant, f"seed={seed}")
    result = None if score is None else make_result(score, seed=seed, overrides=(variant,))
    return Job("_".join(overrides), overrides, seed, result, "" if result else "not finished")


def test_the_page_has_every_variant_its_difference_and_what_is_missing():
    jobs = [job("p=<0>", 1, 0.5), job("p=<0>", 2, 0.52), job("p=1", 1, 0.6), job("p=1", 2)]
    page = Page(as_html({"sweep": "dropout", "command": "python -m x"} | compare(jobs)))
    assert page.needs_nothing_beside_it()
    assert "p=<0> (n=2)" in page.text
    assert "p=1, seed 2: p=1_seed=2: not finished" in page.text
    assert [tag["id"] for tag in page.tags["h2"]] == ["map-by-sensors", "differences", "missing"]
    assert len(page.tags["svg"]) == 14


def test_one_variant_alone_has_no_differences():
    page = Page(as_html({"sweep": "seeds", "command": "python -m x"} | compare([job("p=0", 1, 0.5)])))
    assert [tag["id"] for tag in page.tags["h2"]] == ["map-by-sensors"]


def test_a_sweep_of_ones_own_is_not_said_to_be_a_file():
    known, own = (
        as_markdown({"sweep": name, "command": "python -m x"} | compare([job("p=0", 1, 0.5)]))
        for name in ("dropout", "mine")
    )
    assert "`python train.py -m +sweep=dropout`; this page: `python -m x`." in known
    assert "sweep=mine" not in own
    assert "\nThis page: `python -m x`." in own
