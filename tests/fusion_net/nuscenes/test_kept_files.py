"""Decoded files that are kept: the same arrays, decoded once, safe from writers, and only for as long as it was asked."""

import numpy as np
import pytest

from fusion_net.nuscenes.kept_files import keeping_files
from fusion_net.nuscenes.sensor_files import read_image, read_labels, read_lidar
from tests.fixtures.tiny_tree import HEIGHT, WIDTH, write_camera, write_lidar


def test_a_file_is_decoded_once_within_and_each_time_outside(tmp_path):
    path = tmp_path / "a.jpg"
    write_camera(path, np.eye(4), 0.0)
    before = read_image(path, (HEIGHT, WIDTH))
    with keeping_files():
        first = read_image(path, (HEIGHT, WIDTH))
        path.unlink()
        assert read_image(path, (HEIGHT, WIDTH)) is first
        with pytest.raises(ValueError, match="read-only"):
            first[0] = 0
    np.testing.assert_array_equal(first, before)
    with pytest.raises(FileNotFoundError):
        read_image(path, (HEIGHT, WIDTH))


def test_side_files_and_missing_ones_are_kept_apart(tmp_path):
    write_camera(tmp_path / "a.jpg", np.eye(4), 0.0)
    write_lidar(tmp_path / "a.pcd.bin", np.eye(4), 0.0)
    with keeping_files():
        depth, classes = (
            read_labels(tmp_path / "a.jpg", suffix, (HEIGHT, WIDTH)) for suffix in (".depth.png", ".class.png")
        )
        assert depth.dtype != classes.dtype
        assert read_labels(tmp_path / "b.jpg", ".depth.png", (HEIGHT, WIDTH)) is None
        points, time = read_lidar(tmp_path / "a.pcd.bin")
        assert not points.flags.writeable
        assert not time.flags.writeable
