"""Where the results of cells are kept: one JSON file for each run, set of samples and group of cells, a cell a line.

``RUN/cells/SAMPLES/GROUP.json``, and committed ``RESULTS/JOB/SAMPLES/GROUP.json``. A cell is written as soon as it is
measured, so that a sweep that is interrupted goes on, and one that is asked again with more cells measures those alone.
"""

import json
from pathlib import Path
from typing import Any

from fusion_net.common.atomic import replacing

ABOUT = "about"
SAME = ("weights", "data", "samples")
"""Of ``about``: what cells of one run must share with it to be its own."""


class CellStore:
    """The cells of one run on one set of samples. ``about`` says of which weights and which data they are; cells of others
    in ``folder`` are dropped, and those in ``committed`` are left alone and not used."""

    def __init__(self, folder: Path, *, committed: Path | None, about: dict[str, Any]) -> None:
        self.folder, self.about = folder, about
        self.groups: dict[str, dict[str, Any]] = {}  # results by group and name
        for place in (committed, folder):
            for path in sorted(place.glob("*.json")) if place is not None else ():
                held = read_cells(path)
                own = held.pop(ABOUT)
                if all(own.get(key) == about[key] for key in SAME):
                    self.groups.setdefault(path.stem, {}).update(held)

    def get(self, group: str, name: str) -> dict[str, Any] | None:
        """The result of a cell, if it is there."""
        return self.groups.get(group, {}).get(name)

    def put(self, group: str, name: str, result: dict[str, Any]) -> None:
        """Keeps a result, on disk at once."""
        cells = self.groups.setdefault(group, {})
        cells[name] = result
        write_cells(self.folder / f"{group}.json", self.about, cells)


def read_cells(path: Path) -> dict[str, Any]:
    """The cells of a file by name, and under ``ABOUT`` what they are of. ValueError when it is damaged."""
    try:
        held = dict(json.loads(path.read_bytes()))
        held[ABOUT]["weights"], [dict(cell) for cell in held.values()]
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{path} holds no cells ({type(error).__name__}: {error}); delete it") from error
    return held


def write_cells(path: Path, about: dict[str, Any], cells: dict[str, Any]) -> None:
    """A cell a line, as a whole or not at all."""
    lines = [
        f"{json.dumps(key)}: {json.dumps(value, separators=(',', ':'))}"
        for key, value in ({ABOUT: about} | cells).items()
    ]
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as file:
        file.write(("{\n" + ",\n".join(lines) + "\n}\n").encode())
