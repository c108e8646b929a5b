"""``python train.py experiment=nano name=NAME``: trains a detector into runs/NAME."""

from omegaconf import DictConfig

from fusion_net.common.cli.command import command


@command(config_name="train")
def main(cfg: DictConfig) -> None:
    """Trains what ``cfg`` describes."""
    from fusion_net.runs.checks import check_training

    if cfg.skip_finished and _is_done(cfg):
        return
    check_training(cfg)  # before torch and Lightning are imported, which takes longer
    from fusion_net.fit import fit

    fit(cfg)


def _is_done(cfg: DictConfig) -> bool:
    """Whether the run is finished, and scored if it is to be. If not, ``cfg`` goes on with what there is of it."""
    from fusion_net.evaluate import evaluate_finished
    from fusion_net.reports.run_result import is_scored
    from fusion_net.runs.late import with_detectors
    from fusion_net.runs.run_dir import is_finished, run_folder

    folder = run_folder(cfg.name)
    if not is_finished(folder, with_detectors(cfg)):
        cfg.resume = (folder / "checkpoints" / "last.ckpt").exists()
        cfg.overwrite = not cfg.resume
        return False
    print(f"{folder} is finished")
    if cfg.evaluate and not is_scored(folder):
        evaluate_finished(folder)
    return True


if __name__ == "__main__":
    main()
