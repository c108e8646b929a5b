"""``python train.py experiment=nano name=NAME``: trains a detector into runs/NAME."""

from omegaconf import DictConfig

from fusion_net.cli import command


@command(config_name="train")
def main(cfg: DictConfig) -> None:
    """Trains what ``cfg`` describes."""
    from fusion_net.training.fit import fit

    folder = fit(cfg)
    print(f"done; score it with: python eval.py run={folder}")


if __name__ == "__main__":
    main()
