"""Trees of triangles and packets of rays: the embree library that the ``embreex`` wheel brings, called from compiled loops.

``embreex`` itself casts ray by ray and returns arrays. Packets of 16 rays that lie side by side are two to three times as fast
and meet the same triangles at the same distances, to the last bit; and a loop that fills them needs no arrays in between.
"""

import ctypes
import weakref
from pathlib import Path

import embreex
import llvmlite.binding as llvm
import numpy as np
from numba import types
from numpy.typing import NDArray

from data_gen.jobs.jit import jit

PACKET = 16
"""Rays in a packet."""
_TRIANGLES, _INDICES, _VERTICES, _UINT3, _FLOAT3, _ROBUST = 0, 0, 1, 0x5003, 0x9003, 4
"""RTC_GEOMETRY_TYPE_TRIANGLE, RTC_BUFFER_TYPE_INDEX and _VERTEX, RTC_FORMAT_UINT3 and _FLOAT3, RTC_SCENE_FLAG_ROBUST: rays do
not slip through between triangles that share an edge."""
_COHERENT = 1 << 16
"""RTC_RAY_QUERY_FLAG_COHERENT."""
_FAR, _NORMAL, _PRIMITIVE, _VALID, _SIZE = 8, 12, 17, 21, 22
"""Rows of 16 values of an RTCRayHit16, and how many there are with the mask of its valid rays."""


def _load() -> ctypes.CDLL:
    """The library, its functions known by name to compiled code as well."""
    package = Path(embreex.__file__).parent
    found = [*package.parent.glob("embreex.libs/*embree4*"), *package.glob(".dylibs/*embree4*")]
    if not found:
        raise ImportError(
            f"no embree library lies beside {package}: install embreex from its wheel (pip install embreex)"
        )
    llvm.load_library_permanently(str(found[0]))
    return ctypes.CDLL(str(found[0]))


_library = _load()


def _function(name: str, result: type | None, *arguments: type) -> ctypes._CFuncPtr:  # type: ignore[name-defined]
    function = getattr(_library, name)
    function.restype, function.argtypes = result, arguments
    return function


_Pointer, _Number, _Size = ctypes.c_void_p, ctypes.c_uint, ctypes.c_size_t
_new_scene = _function("rtcNewScene", _Pointer, _Pointer)
_set_flags = _function("rtcSetSceneFlags", None, _Pointer, _Number)
_new_geometry = _function("rtcNewGeometry", _Pointer, _Pointer, _Number)
_new_buffer = _function(
    "rtcSetNewGeometryBuffer", _Pointer, _Pointer, _Number, _Number, _Number, _Size, _Size
)  # fmt: skip
_attach = _function("rtcAttachGeometry", _Number, _Pointer, _Pointer)
_commit_geometry, _release_geometry, _commit_scene, _release_scene = (
    _function(name, None, _Pointer)
    for name in ("rtcCommitGeometry", "rtcReleaseGeometry", "rtcCommitScene", "rtcReleaseScene")
)
_device = _function("rtcNewDevice", _Pointer, ctypes.c_char_p)(b"threads=1")
_intersect16 = types.ExternalFunction("rtcIntersect16", types.void(*[types.intp] * 4))
_occluded16 = types.ExternalFunction("rtcOccluded16", types.void(*[types.intp] * 4))


class Tree:
    """An embree tree over triangles ``faces`` (F, 3) of ``vertices`` (V, 3). ``handle`` is its address, for the loops below."""

    def __init__(self, vertices: NDArray, faces: NDArray) -> None:
        self.handle: int = _new_scene(_device)
        weakref.finalize(self, _release_scene, self.handle)
        _set_flags(self.handle, _ROBUST)
        geometry = _new_geometry(_device, _TRIANGLES)
        _fill(geometry, _VERTICES, _FLOAT3, np.ascontiguousarray(vertices, np.float32))
        _fill(geometry, _INDICES, _UINT3, np.ascontiguousarray(faces, np.uint32))
        _commit_geometry(geometry)
        _attach(self.handle, geometry)
        _release_geometry(geometry)
        _commit_scene(self.handle)


def _fill(geometry: int, kind: int, form: int, values: NDArray) -> None:
    """Copies ``values`` (N, 3) into a new buffer: embree reads beyond the end of one that is only shared."""
    ctypes.memmove(_new_buffer(geometry, kind, 0, form, 12, len(values)), values.ctypes.data, values.nbytes)


@jit
def packet():
    """Room for 16 rays (22, 16), as embree lays them out, and the same memory as integers; no ray has been aimed yet."""
    raw = np.zeros(16 * (_SIZE + 1) + 24, np.float32)
    start = (-raw.ctypes.data // 4) % 16  # embree wants it on a border of 64 bytes
    rays = raw[start : start + 16 * (_SIZE + 1)].reshape(_SIZE + 1, 16)
    ids = rays.view(np.int32)
    ids[9] = -1  # mask
    ids[_SIZE, 0], ids[_SIZE, 1] = _COHERENT, -1  # RTCIntersectArguments: flags, features, and nothing else
    return rays, ids


@jit
def aim(rays, k, ox, oy, oz, dx, dy, dz, far):
    """Sets the ``k``-th ray of a packet."""
    rays[0, k], rays[1, k], rays[2, k] = ox, oy, oz
    rays[4, k], rays[5, k], rays[6, k] = dx, dy, dz
    rays[_FAR, k] = far


@jit
def intersect(tree, rays, ids, count):
    """Casts the first ``count`` rays: then ``rays[8, k]`` is how far away and ``ids[17, k]`` which triangle (-1 none) the k-th
    met, with the normal ``rays[12:15, k]``, not of unit length."""
    for k in range(16):
        ids[_VALID, k] = -1 if k < count else 0
        ids[_PRIMITIVE, k] = ids[_PRIMITIVE + 1, k] = ids[_PRIMITIVE + 2, k] = -1
    base = rays.ctypes.data
    _intersect16(base + 64 * _VALID, tree, base, base + 64 * _SIZE)


@jit
def occluded(tree, rays, ids, count):
    """Casts the first ``count`` rays: then ``rays[8, k] < 0`` where the k-th met anything."""
    for k in range(16):
        ids[_VALID, k] = -1 if k < count else 0
    base = rays.ctypes.data
    _occluded16(base + 64 * _VALID, tree, base, base + 64 * _SIZE)
