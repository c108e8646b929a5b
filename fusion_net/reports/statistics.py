"""Statistics of a data set in the nuScenes format: ``python -m fusion_net.reports.statistics data=nano``.

One page to look at and the same figures as JSON. Settings are in ``configs/statistics.yaml``.
"""

import json
import os
from collections.abc import Sequence
from pathlib import Path

from omegaconf import DictConfig

from fusion_net.common.cli.command import command
from fusion_net.nuscenes.absent import check_data


def write_statistics(
    root: str | Sequence[str],
    *,
    version: str | None = None,
    split: str = "all",
    samples: int = 300,
    out: str | None = None,
) -> Path:
    """Writes ``statistics.html`` (one file, pictures inside) and ``statistics.json`` into the folder ``out``, by default the
    data set's own; returns the page's path. Labels are counted in every keyframe, sensor files are opened in at most
    ``samples`` of them, spread evenly."""
    if samples < 1:
        raise ValueError(f"samples={samples} is not a number of keyframes: 1 or more")
    check_data(root)  # before what reads and draws is imported, which takes longer
    from fusion_net.nuscenes.datasets import open_datasets, samples_of_split
    from fusion_net.reports.dataset.page import render_page
    from fusion_net.reports.dataset.summary import summarize
    from fusion_net.reports.dataset.survey import survey

    folders = [root] if isinstance(root, str) else list(root)
    found = survey(samples_of_split(open_datasets(root, version), split), files=samples)
    name = os.fsencode(", ".join(folders)).decode("utf-8", errors="replace")  # whatever the locale made of it
    summary = {"root": name, "split": split} | summarize(found)
    folder = Path(out or folders[0])
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "statistics.json").write_text(json.dumps(summary, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    page = folder / "statistics.html"
    page.write_text(render_page(found, summary), encoding="utf-8")
    figures = f"{summary['scenes']} scenes, {summary['keyframes']} keyframes, {summary['objects']} objects"
    print(f"{page}: {figures}")
    return page


@command(config_name="statistics")
def main(cfg: DictConfig) -> None:
    """Surveys the data set that ``cfg`` names."""
    write_statistics(cfg.data.root, version=cfg.data.version, split=cfg.split, samples=cfg.samples, out=cfg.out)


if __name__ == "__main__":
    main()
