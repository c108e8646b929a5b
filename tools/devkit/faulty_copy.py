"""A copy of a tree whose tables and radar files can be changed."""

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
from project import nuscenes_format

RADAR_DTYPE = np.dtype([(name, f"<{kind.lower()}{size}") for name, kind, size in nuscenes_format.RADAR_FIELDS])
DATA = b"DATA binary\n"


def channel_of(record: dict) -> str:
    """Channel of a row of sample_data, which only its file's folder names."""
    return record["filename"].split("/")[1]


class FaultyCopy:
    """Files are shared with the tree until they are written."""

    def __init__(self, tree: Path, root: Path) -> None:
        shutil.copytree(tree, root, copy_function=os.link)
        self.root = root
        (self._tables,) = root.glob(f"{nuscenes_format.VERSION_PREFIX}*")

    def rows(self, table: str) -> list[dict]:
        """All rows of a table."""
        return json.loads((self._tables / f"{table}.json").read_text(encoding="utf-8"))

    def write_rows(self, table: str, rows: list[dict]) -> None:
        """Replaces a table."""
        self._write(self._tables / f"{table}.json", json.dumps(rows).encode())

    def mounts(self) -> dict[str, dict]:
        """The row of calibrated_sensor of each radar, by channel."""
        channels = {row["token"]: row["channel"] for row in self.rows("sensor")}
        rows = {channels[row["sensor_token"]]: row for row in self.rows("calibrated_sensor")}
        return {channel: row for channel, row in rows.items() if channel.startswith("RADAR")}

    def write_mounts(self, mounts: dict[str, dict]) -> None:
        """Replaces rows of calibrated_sensor."""
        changed = {row["token"]: row for row in mounts.values()}
        self.write_rows("calibrated_sensor", [changed.get(row["token"], row) for row in self.rows("calibrated_sensor")])

    def records(self, *, channel: str = "", sweeps_only: bool = False) -> list[dict]:
        """Rows of sample_data of one radar or all, by channel and time."""
        rows = [row for row in self.rows("sample_data") if channel_of(row).startswith("RADAR")]
        rows.sort(key=lambda row: (channel_of(row), row["timestamp"]))
        return [row for row in rows if channel in ("", channel_of(row)) and not (sweeps_only and row["is_key_frame"])]

    def write_records(self, records: list[dict]) -> None:
        """Replaces rows of sample_data."""
        changed = {row["token"]: row for row in records}
        self.write_rows("sample_data", [changed.get(row["token"], row) for row in self.rows("sample_data")])

    def change_returns(self, change: Callable[[np.ndarray, dict], np.ndarray | None], **which) -> None:
        """Applies ``change`` to the returns of each scan (a structured array) and its record; it changes them in place or
        gives others."""
        for record in self.records(**which):
            path = self.root / record["filename"]
            returns = self.returns(path)
            changed = change(returns, record)
            self.write_returns(path, returns if changed is None else changed)

    def returns(self, path: Path) -> np.ndarray:
        """The returns of a radar file (P,)."""
        _, body = path.read_bytes().split(DATA, 1)
        return np.frombuffer(body[: len(body) // RADAR_DTYPE.itemsize * RADAR_DTYPE.itemsize], RADAR_DTYPE).copy()

    def write_returns(self, path: Path, returns: np.ndarray) -> None:
        """Replaces the returns of a radar file."""
        head, _ = path.read_bytes().split(DATA, 1)
        lines = head.decode().splitlines()
        count = {"WIDTH": f"WIDTH {len(returns)}", "POINTS": f"POINTS {len(returns)}"}
        lines = [count.get(line.split()[0], line) for line in lines]
        self._write(path, "\n".join(lines).encode() + b"\n" + DATA + returns.tobytes() + b"\n")

    def _write(self, path: Path, data: bytes) -> None:
        path.unlink()
        path.write_bytes(data)
