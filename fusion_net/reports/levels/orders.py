"""The lesson's orders, and whether they hold: of two neighbours the better one must be better on the same scenes."""

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from fusion_net.common.modalities import letters
from fusion_net.evaluation.bootstrap import interval
from fusion_net.evaluation.cells.plan import SWAPPED_BEAMS
from fusion_net.evaluation.drop_table import SUBSETS
from fusion_net.reports.levels.faults import WHOLE, blank_left, swap_left, uncompensated
from fusion_net.reports.levels.scores import Estimate, LevelScores, mean_left, ratio

INFORMATION = ("early", "mid", "late")
ROBUSTNESS = ("late", "mid", "early")
PARTS = [letters(subset) for subset in SUBSETS[1:]]
"""The six proper subsets of the sensors."""


def lesson_orders(found: Mapping[str, LevelScores], seeds: Mapping[str, dict[str, Estimate]]) -> list[dict[str, Any]]:
    """The lesson's two orders: of information on ``seeds`` (mAP by subset of each level, over seeds and scenes), of robustness
    also on each kind of fault."""

    def of(function: Callable[[LevelScores], Estimate | None]) -> dict[str, Estimate | None]:
        return {level: function(scores) for level, scores in found.items()}

    known = {level: mAP for level, mAP in seeds.items() if mAP}
    return [
        verdict("information: mAP with all sensors", INFORMATION, {level: mAP[WHOLE] for level, mAP in known.items()}),
        verdict(
            "graceful dropout: share of mAP left without sensors known to be absent",
            ROBUSTNESS,
            {level: ratio([mAP[name] for name in PARTS], mAP[WHOLE]) for level, mAP in known.items()},
        ),
        verdict("silent death: share of mAP left with one sensor blank", ROBUSTNESS, of(blank_left)),
        verdict(
            "misalignment: share of mAP left with one sensor turned or moved",
            ROBUSTNESS,
            of(lambda scores: mean_left(scores.curves("calibration"))),
        ),
        verdict("shaking mounts: share of mAP left", ROBUSTNESS, of(lambda scores: mean_left(scores.curves("shake")))),
        verdict(
            "clocks: share of mAP left with one sensor late, not compensated",
            ROBUSTNESS,
            of(lambda scores: mean_left(uncompensated(scores.curves("clocks")))),
        ),
        verdict(
            "corruptions: share of mAP left, mean over presets",
            ROBUSTNESS,
            of(lambda scores: mean_left(scores.curves("corruptions"))),
        ),
        verdict(
            f"another LiDAR ({SWAPPED_BEAMS} beams) without training: share of mAP left",
            ROBUSTNESS,
            of(swap_left),
        ),
    ]


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
