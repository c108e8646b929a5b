"""Compares the runs of a sweep: ``python -m fusion_net.reports.ablation runs/sweeps/NAME``.

Settings are in ``configs/ablation.yaml``; docs/ablations.md says how to read the tables.
"""

import sys
from pathlib import Path

from omegaconf import DictConfig

from fusion_net.common.cli.command import command
from fusion_net.common.cli.command_line import name_folder


@command(config_name="ablation")
def report(cfg: DictConfig) -> None:
    """Compares what ``cfg`` names."""
    from fusion_net.reports.ablation.jobs import committed_in, find_jobs

    folder, results = Path(cfg.folder), None if cfg.results is None else Path(cfg.results)
    find_jobs(folder, committed_in(results, folder))  # before what draws is imported, which takes longer
    if results is not None and not results.is_dir() and not cfg.collect:
        print(f"there is no folder {results} of committed results: runs below {folder} alone count", file=sys.stderr)
    from fusion_net.reports.ablation.write import write_ablation

    reference = None if cfg.reference is None else str(cfg.reference)  # 0.3 is a part of a name, too
    write_ablation(folder, results=results, pages=Path(cfg.pages), keep=cfg.collect, reference=reference)


def main() -> None:
    """The folder may be given without its key, first."""
    name_folder()
    report()


if __name__ == "__main__":
    main()
