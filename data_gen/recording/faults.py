"""Faults of the car that is being recorded: the definitions of ``faults``, applied while rendering.

A sensor measures at its true time from its true mount, and then loses what the fault takes; the tables go on telling the
reported time and mount.
"""

from dataclasses import dataclass

from fusion_net.common.faults import FaultPlan, SensorFaults


@dataclass(frozen=True)
class SceneFaults:
    """The faults of one scene. ``channels`` to modalities; tokens of the scene and of its samples, in order."""

    plan: FaultPlan
    channels: dict[str, str]
    scene: str
    samples: list[str]

    def on(self, channel: str, keyframe: int) -> SensorFaults:
        """The faults that are active on a channel in the capture events of a keyframe."""
        return self.plan.on(channel, self.channels, scene=self.scene, sample=self.samples[keyframe])
