"""A small data set, generated once for all tests, none of which may write into it."""

import pytest

from data_gen.generate import generate
from data_gen.rig.mounts import Camera, Lidar, Radar
from data_gen.rig.rig import Rig
from tests.fixtures.lidar_models import HDL32E
from tests.fixtures.small_generation import COMMAND, job, settings


@pytest.fixture(scope="session")
def rig():
    return Rig(
        name="tiny",
        sweeps={"radar": 1, "lidar": 1},
        cameras={
            "CAM_FRONT": Camera(
                translation=[1.7, 0.1, 1.5],
                rotation_deg=[1.0, 2.0, -3.0],
                rate=30.0,
                width=64,
                height=32,
                hfov_deg=70.0,
            )
        },
        lidars={"LIDAR_TOP": Lidar(model=HDL32E, translation=[0.9, 0.0, 1.8], rate=10.0, columns=180)},
        radars={"RADAR_FRONT": Radar(translation=[3.4, 0.0, 0.5], rate=20.0)},
    )


@pytest.fixture(scope="session")
def tree(rig, tmp_path_factory):
    root = tmp_path_factory.mktemp("data") / "tree"
    generate(job(root, rig), settings=settings(), workers=1, command=COMMAND)
    return root
