"""A scene as a recording for the Rerun viewer: ``python -m fusion_net.viz.rerun_log [scene=NAME out=FILE.rrd data.root=DIR]``,
with ``run=runs/NAME`` or ``checkpoint=nano`` also with what the detector finds. ``rerun FILE.rrd`` opens it.

Nothing is opened here, so it runs where there is no screen. Settings are in ``configs/rerun_log.yaml``.
"""

from omegaconf import DictConfig

from fusion_net.common.cli.command import command


@command(config_name="rerun_log")
def main(cfg: DictConfig) -> None:
    """Records the scene that ``cfg`` names."""
    from fusion_net.viz.rerun_log.check import check_recording

    check_recording(cfg)  # before torch is imported, which takes longer
    from fusion_net.viz.rerun_log.write import record

    record(cfg)


if __name__ == "__main__":
    main()
