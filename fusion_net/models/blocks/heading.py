"""A heading as an axis and a direction along it.

A body that looks the same from both ends has two equally good yaws, pi apart. A regression of (sin yaw, cos yaw) answers
with their mean, nothing; the doubled angle is the same for both, so the axis is learned from every body and which end is
the front (a class, as in SECOND, Yan et al. 2018) only from those that have one.
"""

import math

import torch
from torch import Tensor

REFERENCE = math.pi / 4
"""A body faces forwards if its yaw is less than a quarter turn from this one, radians. Headings at which the two classes
meet (135 degrees left, 45 right) are rare: roads lead ahead or across."""


def axis_of(rot: Tensor) -> Tensor:
    """(sin 2 yaw, cos 2 yaw) (..., 2) of (sin yaw, cos yaw) (..., 2)."""
    sine, cosine = rot.unbind(-1)
    return torch.stack([2 * sine * cosine, cosine**2 - sine**2], dim=-1)


def is_forwards(rot: Tensor) -> Tensor:
    """Whether (sin yaw, cos yaw) (..., 2) faces forwards, as a bool (...)."""
    return rot[..., 0] * math.sin(REFERENCE) + rot[..., 1] * math.cos(REFERENCE) > 0


def yaw_of(axis: Tensor, direction: Tensor) -> Tensor:
    """Radians in (-pi, pi] (...) from the axis (..., 2) and the logit (...) that the body faces forwards along it."""
    yaw = torch.atan2(axis[..., 0], axis[..., 1]) / 2
    turned = (torch.cos(yaw - REFERENCE) > 0) != (direction > 0)
    return torch.where(turned, yaw - torch.where(yaw > 0, math.pi, -math.pi), yaw)
