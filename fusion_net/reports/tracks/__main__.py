"""Tracks what a run detects: ``python -m fusion_net.reports.tracks run=runs/NAME``.

Settings are in ``configs/tracks.yaml``; docs/tracks.md says how to read the tables.
"""

from omegaconf import DictConfig

from fusion_net.common.cli.command import command


@command(config_name="tracks")
def main(cfg: DictConfig) -> None:
    """Tracks what ``cfg`` names."""
    from fusion_net.runs.checks import check_detector

    check_detector(cfg)  # before torch is imported, which takes longer
    from fusion_net.reports.tracks.write import report

    report(cfg)


if __name__ == "__main__":
    main()
