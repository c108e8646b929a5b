"""``result.json``: the scores of one run in less than 20 kB, with all that a comparison of runs needs."""

import json
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion_net.common.atomic import replacing
from fusion_net.common.cli.command_line import command_line
from fusion_net.common.modalities import letters
from fusion_net.common.nuscenes_format import MODALITIES

RESULT = "eval/result.json"
"""Where a run keeps the one of its own validation."""
SCALE = 10_000
"""``mAP_resampled`` counts in ten thousandths."""
DROPPED = ("num_gt", "delta_mAP", "delta_mAP_ci95")
"""Columns of a row that are the same in all, or follow from the others."""


def run_result(
    record: dict[str, Any], doc: dict[str, Any], resampled: NDArray[np.float64], *, scored: dict[str, Any]
) -> dict[str, Any]:
    """What is kept. ``record``: what the run was; ``doc``: its drop table as ``drop_table.json`` holds it; ``resampled``
    (7, R): mAP of each row on each resample of the scenes; ``scored``: on which data, split and checkpoint."""
    names = [letters(row["sensors"]) for row in doc["rows"]]
    rows = [{key: value for key, value in row.items() if key not in DROPPED} for row in doc["rows"]]
    counts = np.rint(SCALE * resampled).astype(int).tolist()
    return record | {
        "scored": scored | {"git": doc["git"], "split": doc["split"], "num_samples": doc["num_samples"]},
        "num_gt": doc["rows"][0]["num_gt"],
        "rows": rounded(rows),
        "decoys": rounded(doc.get("decoys", [])),
        "mAP_resampled": dict(zip(names, counts, strict=True)),
    }


def write_result(path: Path, result: dict[str, Any]) -> None:
    """One key a line, so that a diff shows what changed."""
    lines = [f"{json.dumps(key)}: {json.dumps(value, separators=(',', ':'))}" for key, value in result.items()]
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as file:
        file.write(("{\n" + ",\n".join(lines) + "\n}\n").encode())


def read_result(path: Path) -> dict[str, Any]:
    """ValueError when the file is damaged, which says how to have it again."""
    try:
        result = json.loads(path.read_bytes())
        _refuse_damaged(result)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        is_a_runs = path.parts[-2:] == Path(RESULT).parts
        again = command_line("eval.py", run=path.parents[1]) if is_a_runs else f"git checkout -- {path.as_posix()}"
        raise ValueError(f"{path} is no result of a run ({type(error).__name__}); have it again: {again}") from error
    return dict(result)


def is_scored(run: Path) -> bool:
    """Whether a run has a result of its own validation that can be read."""
    try:
        read_result(run / RESULT)
    except (FileNotFoundError, ValueError):
        return False
    return True


def _refuse_damaged(result: dict[str, Any]) -> None:
    """KeyError, TypeError or ValueError where a figure that comparisons need is missing or is no number."""
    result["scored"]["num_samples"], result["encoders"], result["seed"]
    scores = {letters(row["sensors"]): row["mAP"] for row in result["rows"]}
    counts = result["mAP_resampled"]
    subsets = {letters(names) for size in (1, 2, 3) for names in combinations(MODALITIES, size)}
    if missing := subsets - (scores.keys() & counts.keys()):
        raise KeyError(f"no row of {', '.join(sorted(missing))}")
    if not np.isfinite(np.array([*scores.values()], np.float64)).all():
        raise ValueError("a score is no number")
    np.array([counts[name] for name in scores], np.int64).reshape(len(scores), -1)


def rounded(value: Any) -> Any:
    """Nested plain values with four decimals."""
    if isinstance(value, dict):
        return {key: rounded(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [rounded(inner) for inner in value]
    return round(value, 4) if isinstance(value, float) else value
