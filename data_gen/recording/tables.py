"""The 13 nuScenes tables of a finished data set, put together from the scenes' records."""

import json
from pathlib import Path
from typing import Any

from data_gen.recording.tokens import calibration_token, token
from data_gen.rig.rig import Rig
from fusion_net.common.atomic import write_json
from fusion_net.common.geometry import to_quaternion
from fusion_net.common.nuscenes_format import (
    ATTRIBUTES,
    CATEGORY_TO_CLASS,
    DECOY_CATEGORY,
    SPLITS_FILE,
    VERSION_PREFIX,
    VISIBILITY_LEVELS,
)

SCENE_TABLES = ("log", "map", "scene", "sample", "sample_data", "ego_pose", "instance", "sample_annotation")


def write_tables(root: Path, dataset: str, rig: Rig, records: dict[Path, str]) -> dict[str, int]:
    """Writes ``v1.0-DATASET/*.json`` from the scenes' record files, each with its split; returns the rows of each table."""
    folder = root / f"{VERSION_PREFIX}{dataset}"
    folder.mkdir(exist_ok=True)
    rows: dict[str, list[dict[str, Any]]] = _fixed_tables(dataset, rig) | {name: [] for name in SCENE_TABLES}
    named: dict[str, list[str]] = {f"{dataset}_{split}": [] for split in records.values()}
    for record, split in records.items():
        for name, part in json.loads(record.read_text(encoding="utf-8")).items():
            rows[name].extend(part)
        named[f"{dataset}_{split}"].append(rows["scene"][-1]["name"])
    for name, table in rows.items():
        write_json(folder / f"{name}.json", table)
    write_json(folder / SPLITS_FILE, named)
    return {name: len(table) for name, table in rows.items()}


def _fixed_tables(dataset: str, rig: Rig) -> dict[str, list[dict[str, Any]]]:
    """Tables that no scene changes: names, sensors, calibration."""
    return {
        "category": [
            {"token": token("category", c), "name": c, "description": ""} for c in (*CATEGORY_TO_CLASS, DECOY_CATEGORY)
        ],
        "attribute": [{"token": token("attribute", a), "name": a, "description": ""} for a in ATTRIBUTES],
        "visibility": [
            {
                "token": str(i + 1),
                "level": level,
                "description": f"{level[1:]} % of the rays through the object reach it",
            }
            for i, level in enumerate(VISIBILITY_LEVELS)
        ],
        "sensor": [{"token": token("sensor", c), "channel": c, "modality": m} for c, m in rig.modalities.items()],
        "calibrated_sensor": [
            {
                "token": calibration_token(dataset, rig.name, channel),
                "sensor_token": token("sensor", channel),
                "translation": mount.ego_T_sensor[:3, 3].tolist(),
                "rotation": to_quaternion(mount.ego_T_sensor).tolist(),
                **mount.calibration_fields,
            }
            for channel, mount in rig.sensors.items()
        ],
    }
