"""``python train.py experiment=nano name=NAME``: trains a detector into runs/NAME."""

from omegaconf import DictConfig

from fusion_net.common.cli.command import command


@command(config_name="train")
def main(cfg: DictConfig) -> None:
    """Trains what ``cfg`` describes."""
    from fusion_net.evaluate import evaluate_finished
    from fusion_net.fit import fit
    from fusion_net.reports.run_result import RESULT
    from fusion_net.runs.late import with_detectors
    from fusion_net.runs.run_dir import is_finished, run_folder

    folder = run_folder(cfg.name)
    if cfg.skip_finished:
        if is_finished(folder, with_detectors(cfg)):
            print(f"{folder} is finished")
            if cfg.evaluate and not (folder / RESULT).exists():
                evaluate_finished(folder)
            return
        cfg.resume = (folder / "checkpoints" / "last.ckpt").exists()
        cfg.overwrite = not cfg.resume
    fit(cfg)


if __name__ == "__main__":
    main()
