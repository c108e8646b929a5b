"""The project's on-disk contract for the devkit's environment, into which the project is not installed."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[2]))

from fusion_net.common import nuscenes_format

__all__ = ["nuscenes_format"]
