"""``python eval.py run=runs/NAME``: what each sensor is worth to a trained detector."""

from omegaconf import DictConfig

from fusion_net.common.cli.command import command


@command(config_name="eval")
def main(cfg: DictConfig) -> None:
    """Scores the run ``cfg.run`` with every subset of its sensors and writes tables and pictures beside it."""
    from fusion_net.runs.checks import check_evaluation

    check_evaluation(cfg)  # before torch is imported, which takes longer
    from fusion_net.evaluate import evaluate_run

    evaluate_run(cfg)


if __name__ == "__main__":
    main()
