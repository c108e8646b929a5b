"""How far a detector's boxes follow when the calibration of a sensor is moved.

A detector that was trained with one mount has learned where on the ground what it sees at a place in the image belongs: its
boxes follow a turn of the calibration by a part only. That part is measured by moving the calibration in software by a known
amount, and taken out of what is found.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from fusion_net.common.boxes import Boxes
from fusion_net.common.geometry import from_yaw
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.data.batch import Batch
from fusion_net.evaluation.audits.alignment import Motion, align, pair_up
from fusion_net.evaluation.drop_table import Detector

PROBE = Motion(np.radians(2.0), np.array([0.0, 0.5]))
"""The turn about the car's origin and the shift, in metres, by which a sensor's view is moved."""


def moved(batch: Batch, sensor: str, motion: Motion) -> Batch:
    """The batch as it would be if the calibration put everything that ``sensor`` sees elsewhere on the ground."""
    matrix = torch.tensor(from_yaw(motion.turn, (*motion.shift, 0.0)), dtype=torch.float32, device=batch.present.device)
    if sensor == "camera":
        return replace(batch, ego_T_cam=matrix @ batch.ego_T_cam)
    name = f"{sensor}_points"
    points: Tensor = getattr(batch, name).clone()
    points[:, :3] = points[:, :3] @ matrix[:3, :3].T + matrix[:3, 3]
    if sensor == "radar":
        points[:, 4:6] = points[:, 4:6] @ matrix[:2, :2].T
    return replace(batch, **{name: points})


@torch.inference_mode()
def responses(model: Detector, batches: Iterable[Batch], sensors: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Of each sensor, by what part of a turn and by what part of a shift to the side the boxes follow that the detector finds
    with it alone; 1 where too few are found."""
    before: dict[str, list[Boxes]] = {name: [] for name in sensors}
    after: dict[str, list[Boxes]] = {name: [] for name in sensors}
    for batch in batches:
        for name in sensors:
            alone = batch.present & torch.tensor([other == name for other in MODALITIES], device=batch.present.device)
            for found, each in ((before, batch), (after, moved(batch, name, PROBE))):
                found[name] += model.decode(model(each, present=alone))
    parts = {}
    for name in sensors:
        pairs = pair_up(before[name], after[name])
        followed = align(pairs) if len(pairs.weight) else PROBE
        turn, shift = followed.turn / PROBE.turn, float(followed.shift[1] / PROBE.shift[1])
        parts[name] = (float(np.clip(turn, 0.2, 1.5)), float(np.clip(shift, 0.2, 1.5)))
    return parts
