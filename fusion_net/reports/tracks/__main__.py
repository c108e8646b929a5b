"""Tracks what a run detects: ``python -m fusion_net.reports.tracks run=runs/NAME``.

Settings are in ``configs/tracks.yaml``; docs/tracks.md says how to read the tables.
"""

from pathlib import Path

from omegaconf import DictConfig

from fusion_net.common.cli.command import command


@command(config_name="tracks")
def main(cfg: DictConfig) -> None:
    """Tracks what ``cfg`` names."""
    from fusion_net.common.cli.command_line import command_line
    from fusion_net.runs.checks import check_detector
    from fusion_net.runs.sources import source_of

    source_of(cfg)  # a run that is not there is said first
    root = cfg.data.root
    if root is not None and not Path(root).exists():  # other data sets have scenes too short to track
        make = command_line("-m data_gen", data="sequence", data__root=root)
        raise ValueError(f"no data in {root}; make scenes of ten seconds: {make}")
    check_detector(cfg)  # before torch is imported, which takes longer
    from fusion_net.reports.tracks.write import report

    report(cfg)


if __name__ == "__main__":
    main()
