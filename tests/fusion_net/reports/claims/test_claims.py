"""The page of the claims: what is committed is what the program writes, and a missing file is said, not guessed."""

import json
from pathlib import Path

import pytest

from fusion_net.reports.claims import geometry, levels, sensors, training
from fusion_net.reports.claims.__main__ import missing_files, write_claims
from fusion_net.reports.claims.claim import FAILS, HOLDS, OPEN, PARTLY, Claim, verdict
from fusion_net.reports.claims.page import page, sections
from fusion_net.reports.claims.results import Results

ROOT = Path(__file__).resolve().parents[4]


def test_the_committed_page_is_what_the_program_writes():
    """After a change of the results or of the program: ``python -m fusion_net.reports.claims``."""
    assert (ROOT / "docs/claims.md").read_text(encoding="utf-8") == page(ROOT / "docs/results")


def test_the_lessons_arithmetic_holds():
    assert [claim.text for claim in geometry.claims() if claim.verdict != HOLDS] == []


def test_a_claim_whose_file_is_missing_says_so(tmp_path):
    for heading, claims in sections(Results(tmp_path)).items():
        if heading != "Geometry":
            assert {claim.verdict for claim in claims} == {OPEN}
            assert all("is not there" in claim.measured for claim in claims)


def test_the_command_names_the_files_that_are_missing(tmp_path):
    assert missing_files(page(ROOT / "docs/results")) == []
    assert {"docs/results/levels/levels.json", "docs/results/demo/result.json"} <= {*missing_files(page(tmp_path))}


def test_there_are_as_many_rows_with_files_as_without(tmp_path):
    with_files, without = (sections(Results(root)) for root in (ROOT / "docs/results", tmp_path))
    assert {name: [c.text for c in claims] for name, claims in with_files.items()} == {
        name: [c.text for c in claims] for name, claims in without.items()
    }


def test_the_parts_of_a_claim_make_its_verdict():
    assert verdict(True, True) == HOLDS
    assert verdict(True, False) == PARTLY
    assert verdict(False, False) == FAILS
    with pytest.raises(ValueError, match="verdict 'maybe' is none of holds"):
        Claim("a", "b", "c", "maybe")


def test_a_damaged_file_and_a_missing_folder_are_named(tmp_path):
    with pytest.raises(ValueError, match="is no folder; results are committed in docs/results"):
        write_claims(tmp_path / "nowhere", tmp_path / "claims.md")
    (tmp_path / "demo").mkdir()
    for damaged in ("{", "[]", "{}"):
        (tmp_path / "demo/result.json").write_text(damaged)
        with pytest.raises(ValueError, match=r"result.json is damaged"):
            sensors.claims(Results(tmp_path))


def level_results(tmp_path, doc):
    (tmp_path / "levels").mkdir(exist_ok=True)
    (tmp_path / "levels/levels.json").write_text(doc)
    return {claim.text: claim for claim in levels.claims(Results(tmp_path))}


def test_the_orders_of_the_levels_are_taken_as_they_were_judged(tmp_path):
    order = {
        "claim": "misalignment: share of mAP left", "verdict": "does not hold",
        "pairs": [{"pair": "late - mid", "difference": -0.1, "ci95": [-0.2, -0.05]}],
        "values": {level: {"value": 0.5, "ci95": [0.4, 0.6]} for level in ("late", "mid", "early")},
    }  # fmt: skip
    unmeasured = {
        "claim": "information: mAP",
        "verdict": "not measured",
        "missing": ["late"],
        "pairs": [],
        "values": {},
    }
    costs = {
        level: {"parameters": 100, "hanging": {"camera": hang}, "bytes_merged": {"camera": size}}
        for level, hang, size in (("early", 90, 3e6), ("mid", 60, 2e6), ("late", 30, 1e3))
    }
    doc = {"orders": [order, unmeasured], "costs": costs, "seeds": [1], "cell_seeds": [1]}
    found = level_results(tmp_path, json.dumps(doc))
    assert found[levels.ORDERS["misalignment"]].verdict == FAILS
    assert "late - mid -0.100 [-0.200, -0.050]" in found[levels.ORDERS["misalignment"]].why
    assert found[levels.ORDERS["information"]].verdict == OPEN
    assert "no figure of late" in found[levels.ORDERS["information"]].measured
    assert found[levels.COSTS].verdict == HOLDS
    assert found[levels.RETRAIN].verdict == HOLDS


def test_a_file_of_levels_with_nothing_in_it_is_not_measured(tmp_path):
    assert {claim.verdict for claim in level_results(tmp_path, '{"orders": []}').values()} == {OPEN}


def test_the_committed_ablation_is_read():
    claims = training.claims(Results(ROOT / "docs/results"))
    assert OPEN not in {claim.verdict for claim in claims}
    assert all("n = " in claim.measured for claim in claims)
