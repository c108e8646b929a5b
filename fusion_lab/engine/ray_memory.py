"""Rays that were cast before are not cast again: in other weather the same keyframe sends out the same rays.

What a ray meets follows from the scene's bodies and the ray's own time alone, never from weather or light.
"""

from collections import OrderedDict
from collections.abc import Callable
from hashlib import blake2b
from threading import Lock
from typing import Any

import numpy as np

from data_gen.scene.scene import Hits, Scene


class RayMemory:
    """What rays have met, the answers that were asked for last, up to ``limit`` bytes. Several threads may ask."""

    def __init__(self, limit: int) -> None:
        self._limit, self._size = limit, 0
        self._known: OrderedDict[bytes, Hits] = OrderedDict()
        self._lock = Lock()

    def serve(self, scene: Scene) -> None:
        """From now on ``scene``, and what is made of it with ``under``, asks here before it casts."""
        scene.cast = self._remembering(scene, scene.cast)  # type: ignore[method-assign]

    def _remembering(self, scene: Scene, cast: Callable[..., Hits]) -> Callable[..., Hits]:
        def remembered(*rays: Any, **how: Any) -> Hits:
            key = _key(id(scene), rays, how)
            with self._lock:
                if key in self._known:
                    self._known.move_to_end(key)
                    return self._known[key]
            hits = cast(*rays, **how)
            with self._lock:
                self._size += _bytes(hits) if key not in self._known else 0
                self._known[key] = hits
                while self._size > self._limit:
                    self._size -= _bytes(self._known.popitem(last=False)[1])
            return hits

        return remembered


def _key(scene: int, rays: tuple[Any, ...], how: dict[str, Any]) -> bytes:
    digest = blake2b(repr((scene, sorted(how.items()))).encode(), digest_size=16)
    for each in map(np.ascontiguousarray, rays):
        digest.update(repr((each.shape, each.dtype.str)).encode())
        digest.update(each.data)
    return digest.digest()


def _bytes(hits: Hits) -> int:
    return sum(each.nbytes for each in vars(hits).values())
