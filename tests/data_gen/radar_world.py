"""What the radar tests share: two radars, targets that only radar sees, and the detections of many scans."""

import numpy as np
from box_world import car, reflectors

from data_gen.mesh import Asset, Mesh
from data_gen.random import stream
from data_gen.rig import Radar
from data_gen.sensors.radar import detect_radar

RADAR = Radar(translation=[3.41, 0.3, 0.5], rotation_deg=[0.0, 0.0, 2.0], rate=20.0, fov_deg=60.0)
CORNER = Radar(translation=[2.4, -0.8, 0.7], rotation_deg=[0.0, 0.0, -31.0], rate=20.0, fov_deg=60.0)


CELL = np.array([0.4, np.radians(3.2), 0.1])
"""Resolution of both radars in metres, sine of azimuth and m/s."""


def sigma(snr):
    """The noise model by hand: standard deviations (N, 3) of range, sine of azimuth and Doppler; 0.3 of a cell in azimuth."""
    return CELL * (1 / np.sqrt(2 * np.atleast_1d(snr))[:, None] + (0.05, 0.3, 0.05))


def scan_of(world, radar=RADAR, t=0.5, key=0, **more):
    return detect_radar(world, radar, t=t, rng=stream(11, key), **more)


def seen_at(world, radar=RADAR, t=0.5, scans=40, *, body=None, cause=None):
    """Each column over the detections of one body, or of one cause, in many scans."""
    found = [scan_of(world, radar, t, key) for key in range(scans)]
    keep = [s.body == body if cause is None else s.cause == cause for s in found]
    return {n: np.concatenate([getattr(s, n)[k] for s, k in zip(found, keep, strict=True)]) for n in vars(found[0])}


def point_actor(rcs=15.0, height=0.8):
    """A body that only radar sees: a reflector over a mesh too small to hit."""
    asset = car(reflectors([0, 0, height], rcs))
    tiny = Mesh(asset.mesh.vertices * np.float32(1e-3), asset.mesh.faces, asset.mesh.surface)
    return Asset("point", "vehicle.car", asset.size, tiny, asset.scatterers)
