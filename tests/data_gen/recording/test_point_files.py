import numpy as np
import pytest

from data_gen.recording.point_files import RADAR_DTYPE, write_lidar, write_radar
from data_gen.sensors.lidar.lidar import LidarSweep
from data_gen.sensors.radar.radar import RadarScan
from fusion_net.nuscenes.sensor_files import read_lidar


def test_a_radar_record_is_43_packed_bytes():
    assert RADAR_DTYPE.itemsize == 43
    assert len(RADAR_DTYPE) == 18


def test_lidar_columns_come_back(tmp_path):
    sweep = LidarSweep(
        points=np.array([[1.5, -2.0, 0.25], [30.0, 4.0, -1.0]], np.float32),
        intensity=np.array([12.0, 255.0], np.float32),
        ring=np.array([3, 31], np.uint8),
        time=np.array([-0.02, -0.01], np.float32),
        body=np.array([0, -1], np.int32),
        aimed=np.zeros(1, np.int64),
        reached=np.zeros(1, np.int64),
    )
    path = tmp_path / "a__LIDAR_TOP__1.pcd.bin"
    write_lidar(path, sweep)
    assert path.stat().st_size == 2 * 5 * 4
    raw = np.fromfile(path, "<f4").reshape(-1, 5)
    assert raw[:, :3] == pytest.approx(sweep.points)
    assert raw[:, 4].tolist() == [3.0, 31.0]
    assert np.load(tmp_path / "a__LIDAR_TOP__1.time.npy").tolist() == pytest.approx([-0.02, -0.01])
    points, times = read_lidar(path)
    assert (len(points), len(times)) == (2, 2)


@pytest.mark.parametrize("count", [0, 3])
def test_a_radar_file_comes_back_and_an_empty_scan_is_one_record_of_nan(tmp_path, count):
    numbers = {name: np.full(count, value, np.float32) for value, name in enumerate(
        ("x", "y", "rcs", "vx", "vy", "vx_comp", "vy_comp", "range", "azimuth", "doppler", "snr_db"), start=1)}  # fmt: skip
    codes = {
        name: np.full(count, value, np.uint8)
        for name, value in (("dyn_prop", 1), ("ambig_state", 3), ("cause", 2), ("invalid_state", 6), ("pdh0", 4))
    }
    scan = RadarScan(**numbers, **codes, body=np.zeros(count, np.int32))
    path = tmp_path / "a.pcd"
    write_radar(path, scan)
    header, _, body = path.read_bytes().partition(b"DATA binary\n")
    assert len(body) == 43 * max(count, 1) + 1  # the devkit's loader wants a byte behind the last record
    records = np.frombuffer(body[:-1], RADAR_DTYPE)
    assert f"POINTS {max(count, 1)}".encode() in header
    assert (records["ambig_state"] == 3).all()
    assert records["invalid_state"].tolist() == ([6] * count or [0])  # what the sensor thinks; what is true lies beside
    assert records["pdh0"].tolist() == ([4] * count or [0])
    assert np.load(tmp_path / "a.cause.npy").tolist() == [2] * count
    if count:
        assert records["vy_comp"].tolist() == [7.0] * 3
    else:
        assert np.isnan(records["x"]).all()
