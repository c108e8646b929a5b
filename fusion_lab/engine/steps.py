"""The guide: six experiments of the lesson, each a change of the state and what to look for."""

from dataclasses import dataclass, replace
from typing import Any

from fusion_lab.engine.state import LabState, Offer


@dataclass(frozen=True)
class Step:
    """One experiment: what is set, in words and as fields of the state, and what to look for."""

    title: str
    text: str
    look: str
    changes: dict[str, Any]


STEPS = (
    Step(
        "All three sensors, one grid",
        "Nothing is broken. Camera, LiDAR and radar meet as feature maps in the same bird's-eye grid: mid fusion.",
        "Solid boxes lie on dashed ones, near and far. Remember the score: everything that follows is measured against it.",
        {"level": "mid"},
    ),
    Step(
        "Early fusion, the camera turned",
        "Each LiDAR point is painted with the class of the pixel that it falls on, and the camera has turned by 2 degrees.",
        "Points get the paint of what stands beside them: boxes lose their class, shrink, or appear where nothing is. The"
        " view 'Paint a point' shows the same error, point by point.",
        {"level": "early", "turned": "camera", "degrees": 2.0},
    ),
    Step(
        "Late fusion, the same error",
        "The same 2 degrees. Now each sensor detects alone and only boxes are merged.",
        "Only where the camera's own boxes lie has changed; the LiDAR's are as good as before. Compare the change of the"
        " score with that of the step before.",
        {"level": "late", "turned": "camera", "degrees": 2.0},
    ),
    Step(
        "Early fusion, the camera dead",
        "The sun, a stone, a cable: the camera gives nothing. Points go unpainted into the network.",
        "Classes that look alike to a laser, such as billboards and trucks, are mixed up or fall below the threshold; far"
        " objects with few points go first.",
        {"level": "early", "camera": "dead"},
    ),
    Step(
        "Late fusion, the camera dead",
        "The same loss. The other two pipelines do not notice.",
        "What LiDAR and radar found alone is still there, at the same places. Then choose mid fusion: it was trained with"
        " sensors missing at random, so it degrades gracefully too.",
        {"level": "late", "camera": "dead"},
    ),
    Step(
        "A wet highway at dusk",
        "Low sun, a wet road, spray; the camera is blinded and the LiDAR is rained out. Each fails in its own way.",
        "Radar goes through all of it: moving objects keep a place and a velocity (the lines), if not a sharp outline. Kill"
        " the radar too and see what was resting on it.",
        {"level": "mid", "condition": "dusk_glare_spray", "severity": 3, "camera": "blinded", "lidar": "rained out"},
    ),
)


def state_of(step: int, state: LabState, offer: Offer) -> tuple[LabState, str]:
    """The state of a step, from 1, in the scene that is shown; and what to say where its detector is not there."""
    changes = STEPS[step - 1].changes
    level, note = changes["level"], ""
    if level not in offer.levels:
        level = state.level
        note = f"There are no weights of {changes['level']} fusion here, so this is {level} fusion."
    undisturbed = replace(state.undisturbed, beams=offer.beams[0])
    return replace(undisturbed, **changes | {"level": level, "step": step}), note
