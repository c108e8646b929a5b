"""Counter-based random streams, so that no value depends on what was sampled before it elsewhere."""

import hashlib
from collections.abc import Sequence

import numpy as np


def stream(seed: int, *key: str | int) -> np.random.Generator:
    """A generator of its own for (seed, scene, sensor, frame, purpose, ...): the same in any order, process or subset."""
    digest = hashlib.blake2b(repr((seed, *key)).encode(), digest_size=16).digest()
    return np.random.Generator(np.random.Philox(key=np.frombuffer(digest, np.uint64)))


def uniform(rng: np.random.Generator, bounds: Sequence[float]) -> float:
    """A number between ``bounds`` (lowest, highest)."""
    lowest, highest = bounds
    return rng.uniform(lowest, highest)
