"""Early, mid and late fusion in one table: ``python -m fusion_net.reports.levels [runs/sweeps/levels]``.

Settings are in ``configs/levels.yaml``; docs/levels.md says what is measured and how to read it.
"""

from pathlib import Path

from omegaconf import DictConfig

from fusion_net.common.cli.command import command
from fusion_net.common.cli.command_line import job_overrides, name_folder
from fusion_net.common.cli.typed import typed_command


@command(config_name="levels")
def report(cfg: DictConfig) -> None:
    """Compares what ``cfg`` names."""
    from fusion_net.nuscenes.absent import check_data
    from fusion_net.reports.ablation.jobs import committed_in, find_jobs
    from fusion_net.runs.checks import check_counts

    check_counts(cfg)  # before torch is imported, which takes longer
    if any(text.startswith("other_lidar=") for text in job_overrides()) and cfg.other_lidar:
        check_data(cfg.other_lidar)  # the default may be missing, what is asked for may not
    find_jobs(Path(cfg.folder), committed_in(Path(cfg.results), Path(cfg.folder)))
    from fusion_net.reports.levels.measured import Asked
    from fusion_net.reports.levels.write import write_levels

    scenes = cfg.quick_num_scenes if cfg.quick else cfg.num_scenes
    other = cfg.other_lidar if cfg.other_lidar and Path(cfg.other_lidar).exists() else None
    write_levels(
        Path(cfg.folder),
        results=Path(cfg.results),
        pages=Path(cfg.pages),
        groups=list(cfg.cells),
        asked=Asked(split=cfg.split, scenes=scenes, batch_size=cfg.batch_size, resamples=cfg.bootstrap),
        quick=cfg.quick,
        seeds=list(cfg.seeds),
        other_lidar=other,
        keep=cfg.collect,
        only_read=cfg.only_read,
        typed=f"python {typed_command()}",
    )


def main() -> None:
    """The folder may be given without its key, first."""
    name_folder()
    report()


if __name__ == "__main__":
    main()
