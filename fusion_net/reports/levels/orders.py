"""The lesson's orders, and whether they hold: of two neighbours the better one must be better on the same scenes."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from fusion_net.evaluation.bootstrap import interval
from fusion_net.reports.levels.scores import Estimate

INFORMATION = ("early", "mid", "late")
ROBUSTNESS = ("late", "mid", "early")


def verdict(claim: str, order: Sequence[str], found: Mapping[str, Estimate | None]) -> dict[str, Any]:
    """Of a claim that ``found`` falls along ``order``: each pair of neighbours with the difference and its 95 % interval, and

    * "holds" where every interval is above 0, "does not hold" where every one is below it or the first and the last are
      exchanged beyond it; "holds partly" where some are above 0; "undecided" where none is on either side;
    * "not measured" where a level has no figure.
    """
    missing = [level for level in order if found.get(level) is None]
    if missing:
        return {"claim": claim, "verdict": "not measured", "missing": missing, "pairs": [], "values": {}}
    known = {level: found[level] for level in order}
    pairs = [_pair(one, other, known) for one, other in pairwise(order)]
    ends = _pair(order[0], order[-1], known)
    return {
        "claim": claim,
        "verdict": _word([*pairs], ends),
        "pairs": [*pairs, ends],
        "values": {level: each.plain() for level, each in known.items() if each is not None},
    }


def _pair(one: str, other: str, found: Mapping[str, Estimate | None]) -> dict[str, Any]:
    better, worse = found[one], found[other]
    assert better is not None
    assert worse is not None
    return {
        "pair": f"{one} - {other}",
        "difference": better.value - worse.value,
        "ci95": interval(np.asarray(better.draws) - np.asarray(worse.draws)),
    }


def _word(pairs: Sequence[dict[str, Any]], ends: dict[str, Any]) -> str:
    above, below = ([pair["ci95"][0] > 0 for pair in pairs], [pair["ci95"][1] < 0 for pair in pairs])
    if all(above):
        return "holds"
    if all(below) or ends["ci95"][1] < 0:
        return "does not hold"
    if any(above) or ends["ci95"][0] > 0:
        return "holds partly"
    return "does not hold" if any(below) else "undecided"
