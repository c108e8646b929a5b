"""A lab of two short scenes, a small rig and an untrained network, made once for all tests."""

from pathlib import Path

import pytest
import torch

from fusion_lab.engine.answers import Lab
from fusion_lab.engine.studio import Studio
from fusion_net.common.cli.command import build
from fusion_net.common.cli.composed import composed
from fusion_net.runs.trained import Trained
from tests.fixtures.small_lab import generated
from tests.fixtures.training_setup import SMALL


@pytest.fixture(scope="session")
def studio(tmp_path_factory):
    job = generated(tmp_path_factory.mktemp("lab") / "clear", "condition=clear")
    return Studio(job, build(composed("data_gen").condition, "condition"))


@pytest.fixture(scope="session")
def lab(studio):
    cfg = composed("train", *SMALL)
    torch.manual_seed(0)
    weights = build(cfg.model, "model").state_dict()
    return Lab(studio, {"mid": Trained(Path("run"), Path("run/best.ckpt"), cfg, weights, {})})
