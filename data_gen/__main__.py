"""``python -m data_gen data=nano``: generates a data set in the nuScenes format."""

from typing import Any, cast

from omegaconf import DictConfig, OmegaConf

from fusion_net.cli import build, command


@command(config_name="data_gen")
def main(cfg: DictConfig) -> None:
    """Generates ``cfg.data`` with ``cfg.rig``, ``cfg.scenario`` and ``cfg.condition``."""
    from data_gen.generate import Job, generate

    data = build(cfg.data, "data")
    job = Job(
        data=data,
        rig=build(cfg.rig, "rig"),
        scenario=build(cfg.scenario, "scenario"),
        condition=build(cfg.condition, "condition"),
        seed=cfg.seed,
    )
    settings = cast(dict[str, Any], OmegaConf.to_container(cfg, resolve=True))
    manifest = generate(job, settings=settings, workers=cfg.workers)
    counts = manifest["counts"]
    print(
        f"{data.root}: {counts['scene']} scenes, {counts['sample']} keyframes, {counts['sample_annotation']} boxes;"
        f" manifest {manifest['hash'][:12]}"
    )


if __name__ == "__main__":
    main()
