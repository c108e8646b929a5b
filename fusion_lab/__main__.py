"""``python -m fusion_lab [run=runs/NAME]``: the failure lab in the browser, on this machine."""

from importlib.util import find_spec
from pathlib import Path

from omegaconf import DictConfig

from fusion_net.common.cli.command import command


@command(config_name="lab")
def main(cfg: DictConfig) -> None:
    """Opens the page. Settings are in ``configs/lab.yaml``."""
    if find_spec("nicegui") is None:
        raise ValueError(
            "the failure lab needs NiceGUI, an optional extra: python -m pip install -c constraints.txt -e '.[lab]'"
        )
    from fusion_lab.page.address import check_port
    from fusion_net.runs.sources import checkpoint_path

    if not cfg.data.root:
        raise ValueError("data.root is where the scenes are kept; write data.root=data/lab")
    runs = [cfg.run] if isinstance(cfg.run, str) else list(cfg.run or [])
    check_port(cfg.host, cfg.port)  # both before torch is imported, which takes longer
    for run in runs:
        checkpoint_path(Path(run), cfg.checkpoint)
    from fusion_lab.engine.answers import Lab
    from fusion_lab.engine.detectors import offered
    from fusion_lab.engine.studio import open_studio
    from fusion_lab.page.serve import serve

    trained = offered(runs, cfg.checkpoint)
    rig = next(iter(trained.values())).cfg.data.name
    size = {"scenes": cfg.data.num_scenes, "keyframes": cfg.data.keyframes}
    studio = open_studio(Path(cfg.data.root), rig=rig, **size, seed=cfg.seed)
    lab = Lab(studio, trained)
    lab.warm_up()
    serve(lab, host=cfg.host, port=cfg.port, show=cfg.show)


if __name__ == "__main__":
    main()
