"""Named arrays as one block of bytes and back, exactly; the arrays that are read are views of the block, so it may be mapped.

The block: the length of its head (8 bytes, little-endian), the head (JSON: a label, and of each array its name, type, shape
and place), then the arrays, each at a multiple of ``ALIGNMENT`` bytes from the start.
"""

import json
from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

ALIGNMENT = 64
"""Bytes: a cache line, the widest that vector instructions ask for."""


def block_parts(label: str, arrays: Mapping[str, NDArray]) -> Iterator[bytes]:
    """The parts of a block, to be joined or written one after the other."""
    places, end = [], 0
    for name, array in arrays.items():
        places.append((name, array.dtype.str, array.shape, end))
        end += aligned(array.nbytes)
    head = json.dumps([label, places], separators=(",", ":")).encode()
    start = len(head).to_bytes(8, "little") + head
    yield start.ljust(aligned(len(start)), b"\0")
    for array in arrays.values():
        yield array.tobytes().ljust(aligned(array.nbytes), b"\0")


def read_block(block: memoryview | bytes) -> tuple[str, dict[str, NDArray]]:
    """The label and the arrays of a block."""
    length = int.from_bytes(block[:8], "little")
    label, places = json.loads(bytes(block[8 : 8 + length]))
    start = aligned(8 + length)
    return label, {name: np.ndarray(shape, kind, block, start + offset) for name, kind, shape, offset in places}


def aligned(size: int) -> int:
    """The next multiple of ``ALIGNMENT``."""
    return -(-size // ALIGNMENT) * ALIGNMENT
