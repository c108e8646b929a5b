"""``python -m data_gen data=nano``: generates a data set in the nuScenes format."""

from pathlib import Path
from typing import Any, cast

from omegaconf import DictConfig, OmegaConf

from fusion_net.common.cli.command import build, command
from fusion_net.common.cli.typed import typed_words


@command(config_name="data_gen")
def main(cfg: DictConfig) -> None:
    """Generates ``cfg.data`` with ``cfg.rig``, ``cfg.scenario``, ``cfg.condition`` and ``cfg.fault``."""
    from data_gen.generate import Job, generate
    from data_gen.jobs.manifest import without_place
    from data_gen.jobs.shard import Shard

    data = build(cfg.data, "data")
    job = Job(
        data=data,
        rig=build(cfg.rig, "rig"),
        scenario=build(cfg.scenario, "scenario"),
        condition=build(cfg.condition, "condition"),
        faults=build(cfg.fault, "fault"),
        seed=cfg.seed,
    )
    settings = cast(dict[str, Any], OmegaConf.to_container(cfg, resolve=True))
    shard = None if cfg.shard is None else Shard.parse(str(cfg.shard))
    manifest = generate(
        job,
        settings=settings,
        workers=cfg.workers,
        shard=shard,
        command=without_place(["python", *typed_words()]),
    )
    counts = manifest["counts"]
    root = shard.folder(Path(data.root)) if shard else data.root
    print(
        f"{root}: {counts['scene']} scenes, {counts['sample']} keyframes,"
        f" {counts['sample_annotation']} boxes; manifest {manifest['hash'][:12]}"
    )


if __name__ == "__main__":
    main()
