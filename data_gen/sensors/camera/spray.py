"""Spray as a camera sees it: plumes of mist, as bright as the air, before whatever is behind."""

import numpy as np
from numpy.typing import NDArray

from data_gen.jobs.jit import jit
from data_gen.scene.light import airlight
from data_gen.scene.spray import Plumes, penetrate
from data_gen.sensors.camera.rendering.lamps import LAMP_COLOR, beam_lux
from data_gen.sensors.camera.rendering.renderer import MAX_RANGE, Renderer

_MIST_ALBEDO = 0.6
"""Fraction of the lamplight on a plume that it sends back all around."""
_SURFACE = 0.4
"""Optical depth at which a plume is taken to be lit."""


def add_spray(
    linear: NDArray[np.float32],
    renderer: Renderer,
    plumes: Plumes,
    rays: NDArray[np.float32],
    distance: NDArray[np.float32],
) -> None:
    """Draw plumes over the luminance (N, 3) along ``rays`` (N, 3) that end at ``distance`` (N,), in place:
    L exp(-tau) + airlight (1 - exp(-tau))."""
    tau, stop = penetrate(plumes, renderer.view.origin, rays, np.minimum(distance, MAX_RANGE), _SURFACE)
    visible = np.flatnonzero(tau > 0.01)
    at = np.minimum(np.where(np.isfinite(stop), stop, distance), 60.0)
    _mix(visible, tau, at, rays, renderer.view.origin, renderer.light, renderer.lamps.beams, linear)


@jit
def _mix(visible, tau, at, rays, origin, light, beams, linear):
    mist, p = np.empty(3), np.empty(3)
    for i in visible:
        d = rays[i]
        for c in range(3):
            p[c] = origin[c] + d[c] * at[i]
        airlight(np.float64(d[0]), np.float64(d[1]), np.float64(d[2]), light, mist)
        lamp = beam_lux(p, -d, beams) * _MIST_ALBEDO / (4 * np.pi) if len(beams) else 0.0
        through = np.exp(-tau[i])
        for c in range(3):
            linear[i, c] = linear[i, c] * through + (mist[c] + lamp * LAMP_COLOR[c]) * (1 - through)
