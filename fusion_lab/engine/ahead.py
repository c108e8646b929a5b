"""What may be set next, so that it can be rendered while nobody waits: other weather of the keyframe, and the next keyframe."""

from collections.abc import Iterator
from dataclasses import replace

from fusion_lab.engine.state import LabState, Offer


def near(state: LabState, offer: Offer) -> Iterator[LabState]:
    """One step of a slider away: the other severities, nearest first, and the next keyframe."""
    severities = range(1, offer.conditions[state.condition] + 1)
    for severity in sorted(severities, key=lambda each: abs(each - state.severity))[1:]:
        yield replace(state, severity=severity)
    yield replace(state, frame=(state.frame + 1) % offer.frames)


def far(state: LabState, offer: Offer) -> Iterator[LabState]:
    """All other weather and light of the keyframe, first that of the severity that is set."""
    for further in (False, True):
        for condition, levels in offer.conditions.items():
            for severity in range(1, levels + 1):
                if condition != state.condition and (severity != min(state.severity, levels)) == further:
                    yield replace(state, condition=condition, severity=severity)
