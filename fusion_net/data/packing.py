"""A decoded sample as one block of bytes and back, exactly: what :mod:`fusion_net.data.disk_cache` stores."""

from dataclasses import fields
from typing import Any

import numpy as np

from fusion_net.common.array_block import block_parts, read_block
from fusion_net.common.boxes import Boxes
from fusion_net.data.samples import Sample

NARROW = {"class_map": (np.int8, np.int64)}
"""Arrays whose every value fits in a smaller type: (on disk, in a sample)."""
_BOXES = tuple(field.name for field in fields(Boxes))
_ARRAYS = tuple(field.name for field in fields(Sample) if field.name not in ("token", "boxes"))


def pack(sample: Sample) -> bytes:
    """The block of a sample."""
    arrays = {name: getattr(sample, name) for name in _ARRAYS} | {name: getattr(sample.boxes, name) for name in _BOXES}
    there = {name: array for name, array in arrays.items() if array is not None}
    stored = {name: array.astype(NARROW[name][0]) if name in NARROW else array for name, array in there.items()}
    return b"".join(block_parts(sample.token, stored))


def unpack(block: memoryview | bytes) -> Sample:
    """The sample of a block. Its arrays are views of the block where they have the type that is stored."""
    token, stored = read_block(block)
    arrays: dict[str, Any] = dict.fromkeys((*_ARRAYS, *_BOXES)) | stored
    for name in NARROW.keys() & stored.keys():
        arrays[name] = stored[name].astype(NARROW[name][1])
    boxes = Boxes(**{name: arrays.pop(name) for name in _BOXES})
    return Sample(token=token, boxes=boxes, **arrays)
