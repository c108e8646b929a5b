"""What a recording can be refused for before torch is imported, which takes longer."""

from importlib.util import find_spec

from omegaconf import DictConfig, OmegaConf

from fusion_net.common.checks import check_names
from fusion_net.nuscenes.absent import check_data
from fusion_net.runs.checks import check_detector
from fusion_net.runs.sources import OF_A_RUN

ROOT = "data/nano"
"""The data without a detector that was trained on some."""
COLORINGS = ("intensity", "height")
"""What colours LiDAR points."""


def check_recording(cfg: DictConfig) -> None:
    """ValueError or FileNotFoundError where the extra, the detector or the data is not there."""
    if find_spec("rerun") is None:
        raise ValueError(
            "recordings need the Rerun SDK, an optional extra: python -m pip install -c constraints.txt -e '.[rerun]'"
        )
    check_names("lidar_color", [cfg.lidar_color], COLORINGS)
    if shows_detections(cfg):
        check_detector(cfg)
    else:
        check_data(cfg.data.root or ROOT)


def shows_detections(cfg: DictConfig) -> bool:
    """Whether a detector is named and asked."""
    return bool(cfg.detections) and (not OmegaConf.is_missing(cfg, "run") or cfg.checkpoint not in OF_A_RUN)
