"""Tokens, names and time stamps: they follow from the data set and the scene alone, whoever writes them in whatever order."""

import hashlib
from dataclasses import dataclass

EPOCH_US = 1_700_000_000_000_000
"""Time stamp of the first scene's zero."""
SCENE_US = 100_000_000
"""Microseconds from a scene to the next."""


def token(*parts: str | int) -> str:
    """32 hexadecimal digits that follow from the parts."""
    return hashlib.blake2b(repr(parts).encode(), digest_size=16).hexdigest()


def calibration_token(dataset: str, rig: str, channel: str) -> str:
    """Of a calibrated_sensor."""
    return token(dataset, rig, channel, "calibration")


@dataclass(frozen=True)
class SceneNames:
    """What a scene, called ``scene`` and the ``index``-th of its data set, and its parts are called."""

    dataset: str
    scene: str
    index: int

    @property
    def log(self) -> str:
        """Each scene has a log of its own."""
        return f"{self.dataset}-{self.scene}"

    @property
    def log_token(self) -> str:
        """Of the log."""
        return token(self.log)

    @property
    def scene_token(self) -> str:
        """Of the scene."""
        return token(self.log, "scene")

    def sample_tokens(self, keyframes: int) -> list[str]:
        """Of the samples, in order."""
        return [token(self.log, "sample", k) for k in range(keyframes)]

    def stamp(self, t: float) -> int:
        """Microseconds since 1970 of ``t`` seconds of the episode."""
        return EPOCH_US + self.index * SCENE_US + round(t * 1e6)
