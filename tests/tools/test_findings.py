"""The oracle's report: what has too few cases says so, like findings share a line, each failure has its own."""

import sys
from pathlib import Path

import pytest


@pytest.fixture
def findings(monkeypatch):
    monkeypatch.syspath_prepend(Path(__file__).parents[2] / "tools/devkit")
    import findings

    yield findings
    sys.modules.pop("findings")


def test_too_few_cases_are_said_and_neither_pass_nor_fail(findings):
    few = findings.Finding("bearing", 9.0, "<=", 1.0, 12, "deg", "RADAR_FRONT, 50 ms before", need=60)
    assert few.is_open
    assert few.passed
    assert few.line() == "  --   bearing [RADAR_FRONT, 50 ms before]: too few cases (12 of 60)"


def test_like_findings_share_a_line_but_each_failure_has_its_own(findings):
    like = [findings.Finding("bearing", figure, "<=", 1.0, 80, "deg", f"{figure}") for figure in (0.2, 0.9, 0.5)]
    (line,) = findings.report(like)
    assert line.startswith("  ok   bearing [0.9]: 0.9 deg")
    assert line.endswith("2 more, 0 of them with too few")
    wrong = [findings.Finding("bearing", figure, "<=", 1.0, 80, "deg", f"{figure}") for figure in (2.0, 3.0)]
    assert [line[:20] for line in findings.report(like + wrong)] == [" FAIL  bearing [2.0]", " FAIL  bearing [3.0]"]


def test_the_finding_nearest_to_a_lower_limit_is_shown(findings):
    like = [findings.Finding("met", figure, ">=", 0.8, 80, case=f"{figure}") for figure in (0.99, 0.82, 0.9)]
    assert "[0.82]" in next(findings.report(like))
