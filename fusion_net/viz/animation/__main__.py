"""A moving picture of one scene with its detections, in which a sensor dies and comes back:
``python -m fusion_net.viz.animation run=runs/NAME`` or ``checkpoint=nano``.

Settings are in ``configs/animation.yaml``.
"""

from omegaconf import DictConfig

from fusion_net.common.cli.command import command


@command(config_name="animation")
def main(cfg: DictConfig) -> None:
    """Animates the scene that ``cfg`` names."""
    from fusion_net.runs.checks import check_detector

    check_detector(cfg)  # before torch is imported, which takes longer
    from fusion_net.viz.animation.write import animate

    animate(cfg)


if __name__ == "__main__":
    main()
