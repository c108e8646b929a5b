"""Where does the detector fail? Its score by condition, range and visibility, never only over everything."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion_net.common.modalities import STYLES
from fusion_net.evaluation.audits.result import Audit
from fusion_net.evaluation.drop_table import SUBSETS
from fusion_net.evaluation.scoring import GroundTruth
from fusion_net.evaluation.strata import GroupScore, by_condition, by_range, by_visibility, known_interval, score_groups
from fusion_net.metrics.sample_boxes import SampleBoxes
from fusion_net.nuscenes.nuscenes import NuScenes

FEWEST_LABELS = 50
"""Groups with fewer labels are shown and not judged."""
LEAST_LEFT = 0.5
"""Share of the clear scenes' mAP that has to be left in every condition."""
HARM = 0.02
"""mAP by which a subset of the sensors may be better than all of them."""


def audit_conditions(
    truth: GroundTruth,
    samples: Sequence[tuple[NuScenes, str]],
    tables: Sequence[SampleBoxes],
    copies: NDArray[np.int64],
) -> Audit:
    """``tables``: predictions of each subset of SUBSETS; ``copies`` (R, S): resamples of the scenes, the same for all."""
    title = "Per condition, range and visibility: where does the average hide a failure?"
    explanation = (
        "mAP over the classes that have labels in the group; a prediction counts where the label is that it takes, a false"
        " alarm where it lies. Conditions are judged: wrong where, with all sensors, less than half of the clear scenes' mAP is"
        f" left, or where a sensor harms: without it the mAP is more than {HARM:g} higher, its 95 % interval above 0. Groups"
        f" of fewer than {FEWEST_LABELS} labels are shown, not judged. Intervals are 95 % over scenes, differences on the"
        " same resamples."
    )
    scored: dict[str, list[list[GroupScore]]] = {}  # by axis: by subset: by group
    for grouping in (by_condition(truth, samples), by_range(truth), by_visibility(truth)):
        scored[grouping.axis] = [score_groups(truth, table, grouping, copies) for table in tables]
    numbers: dict[str, Any] = {
        axis: [
            {"group": of_all.name, "labels": sum(of_all.num_gt.values()), "num_gt": of_all.num_gt}
            | {"rows": [_row(subset, by_subset[place]) for subset, by_subset in zip(SUBSETS, scores, strict=True)]}
            for place, of_all in enumerate(scores[0])
        ]
        for axis, scores in scored.items()
    }
    by_name = {score.name: score for score in scored["condition"][0]}
    judged = {name: score for name, score in by_name.items() if sum(score.num_gt.values()) >= FEWEST_LABELS}
    if "clear" not in judged or len(judged) < 2 or judged["clear"].mAP <= 0:
        there = ", ".join(by_name) or "none"
        verdict = f"conditions here: {there}; judged is what is left of the mAP of clear scenes in others"
        return Audit("conditions", title, verdict, None, numbers, explanation)
    left = {name: score.mAP / judged["clear"].mAP for name, score in judged.items() if name != "clear"}
    worst = min(left, key=lambda name: left[name])
    harmful = [each for each in _harm(scored["condition"]) if each["condition"] in judged]
    numbers |= {"left": left, "harm": harmful}
    kept = judged[worst].resampled / np.maximum(judged["clear"].resampled, 1e-9)
    clear, worse = judged["clear"], judged[worst]
    ends = known_interval(kept, min(clear.scenes, worse.scenes))
    text = f"worst in {_words(worst)}: mAP {worse.mAP:.3f}, {100 * left[worst]:.0f} %"
    text += f" [{100 * ends[0]:.0f}, {100 * ends[1]:.0f}]" if ends else " (one scene: no interval)"
    text += f" of {clear.mAP:.3f} when it is clear"
    for each in harmful:
        text += (
            f"; in {_words(each['condition'])} {each['difference']:.3f} better without {STYLES[each['without']].label}"
        )
    return Audit("conditions", title, text, left[worst] >= LEAST_LEFT and not harmful, numbers, explanation)


def _row(subset: Sequence[str], score: GroupScore) -> dict[str, Any]:
    return {"sensors": list(subset), "mAP": score.mAP, "mAP_ci95": score.interval, "AP": score.AP}


def _words(name: str) -> str:
    return name.replace("_", " ")


def _harm(scores: Sequence[Sequence[GroupScore]]) -> list[dict[str, Any]]:
    """Conditions in which two sensors are better than three."""
    found = []
    for subset, by_group in zip(SUBSETS[1:4], scores[1:4], strict=True):
        (without,) = set(SUBSETS[0]) - set(subset)
        for part, whole in zip(by_group, scores[0], strict=True):
            ends = known_interval(part.resampled - whole.resampled, whole.scenes)
            if part.mAP - whole.mAP > HARM and ends and ends[0] > 0:
                found.append(
                    {"condition": part.name, "without": without, "difference": part.mAP - whole.mAP, "ci95": ends}
                )
    return found
