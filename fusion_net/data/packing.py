"""A decoded sample as one block of bytes and back, exactly: what :mod:`fusion_net.data.disk_cache` stores.

The block: the length of its head (8 bytes, little-endian), the head (JSON: the sample's token, and of each array its name,
type, shape and place), then the arrays, each at a multiple of ``ALIGNMENT`` bytes from the start.
"""

import json
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion_net.common.boxes import Boxes
from fusion_net.data.samples import Sample

ALIGNMENT = 64
"""Bytes: a cache line, the widest that vector instructions ask for."""
NARROW = {"class_map": (np.int8, np.int64)}
"""Arrays whose every value fits in a smaller type: (on disk, in a sample)."""
_BOXES = tuple(field.name for field in fields(Boxes))
_ARRAYS = tuple(field.name for field in fields(Sample) if field.name not in ("token", "boxes"))


def pack(sample: Sample) -> bytes:
    """The block of a sample."""
    arrays = {name: getattr(sample, name) for name in _ARRAYS} | {name: getattr(sample.boxes, name) for name in _BOXES}
    places: list[tuple[str, str, tuple[int, ...], int]] = []
    parts: list[bytes] = []
    end = 0
    for name, array in arrays.items():
        if array is None:
            continue
        stored = array.astype(NARROW[name][0]) if name in NARROW else np.ascontiguousarray(array)
        places.append((name, stored.dtype.str, stored.shape, end))
        parts.append(stored.tobytes().ljust(aligned(stored.nbytes), b"\0"))
        end += len(parts[-1])
    head = json.dumps([sample.token, places], separators=(",", ":")).encode()
    start = len(head).to_bytes(8, "little") + head
    return b"".join([start.ljust(aligned(len(start)), b"\0"), *parts])


def unpack(block: memoryview | bytes) -> Sample:
    """The sample of a block. Its arrays are views of the block where they have the type that is stored."""
    length = int.from_bytes(block[:8], "little")
    token, places = json.loads(bytes(block[8 : 8 + length]))
    start = aligned(8 + length)
    arrays: dict[str, NDArray[Any] | None] = dict.fromkeys((*_ARRAYS, *_BOXES))
    for name, kind, shape, offset in places:
        array = np.ndarray(shape, kind, block, start + offset)
        arrays[name] = array.astype(NARROW[name][1]) if name in NARROW else array
    boxes = Boxes(**{name: arrays.pop(name) for name in _BOXES})  # type: ignore[arg-type]
    return Sample(token=token, boxes=boxes, **arrays)  # type: ignore[arg-type]


def aligned(size: int) -> int:
    """The next multiple of ``ALIGNMENT``."""
    return -(-size // ALIGNMENT) * ALIGNMENT
