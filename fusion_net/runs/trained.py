"""A trained detector, from a run's folder or from a file of shipped weights, and what made it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf
from torch import Tensor

from fusion_net.common.cli.command import build
from fusion_net.common.cli.composed import composed
from fusion_net.models.fusion_net import FusionNet
from fusion_net.models.weights_file import compact, fit_weights, read_weights, write_weights
from fusion_net.runs.checkpoints import load_weights, model_weights, read_checkpoint
from fusion_net.runs.checks import check_init
from fusion_net.runs.run_dir import ABOUT_THE_FOLDER, load_config, renewed, surroundings
from fusion_net.runs.sources import EVALUATIONS, checkpoint_path, shipped_path, source_of


@dataclass(frozen=True)
class Trained:
    """Weights, the settings that they were trained with, and what the run was."""

    folder: Path  # below which evaluations of it are kept
    source: Path
    cfg: DictConfig
    weights: Mapping[str, Tensor]
    record: dict[str, Any]

    @property
    def is_shipped(self) -> bool:
        """Whether there is no run's folder that says more."""
        return self.source.suffix == ".pt"

    def model(self) -> FusionNet:
        """The detector in evaluation mode."""
        model: FusionNet = build(self.cfg.model, "model")
        fit_weights(model, self.weights, self.source)
        return model.eval()

    def compact(self) -> "Trained":
        """The same with the weights as a file of shipped weights holds them."""
        return replace(self, weights=compact(self.weights))


def trained_of(cfg: DictConfig) -> Trained:
    """What a command's ``run`` and ``checkpoint`` name: a run's checkpoint, or without a run shipped weights."""
    source_of(cfg)
    return shipped(cfg.checkpoint) if OmegaConf.is_missing(cfg, "run") else trained_run(Path(cfg.run), cfg.checkpoint)


def trained_run(folder: Path, checkpoint: str) -> Trained:
    """The detector in ``RUN/checkpoints/CHECKPOINT.ckpt``."""
    path = checkpoint_path(folder, checkpoint)
    cfg = load_config(folder)
    if missing := [key for key in ("seed", "classes", "encoders", "dataset", "model", "trainer") if key not in cfg]:
        raise ValueError(
            f"{folder / 'config.yaml'} is cut off, or of something else: it has no {', '.join(missing)}; train the run again"
        )
    return Trained(folder, path, cfg, model_weights(read_checkpoint(path)), run_record(folder, cfg))


def shipped(name: str) -> Trained:
    """The detector of ``checkpoints/NAME.pt``, or of a file by its path; evaluations go below ``runs/checkpoints/NAME``."""
    path = shipped_path(name)
    held = read_weights(path)
    made_by = {each["hash"]: each["command"] for each in held["manifest"] if each.get("command")}
    record = held["record"] | {"made_by": made_by | (held["record"].get("made_by") or {})}
    return Trained(EVALUATIONS / path.stem, path, OmegaConf.create(renewed(held["config"])), held["weights"], record)


def initialise(model: FusionNet, name: str) -> None:
    """Loads shipped weights, or a run's checkpoint by its path, into a model that is to be trained further."""
    path = check_init(name)
    try:
        if path.suffix == ".ckpt":
            load_weights(model, path)
        else:
            fit_weights(model, read_weights(path)["weights"], path)
    except ValueError as error:
        raise ValueError(f"init={name}: {error}") from error


def ship(path: Path, trained: Trained, *, table: dict[str, Any], manifests: Sequence[dict[str, Any]]) -> Path:
    """Writes a detector as a file of shipped weights, with its drop table and the manifests of its data. The settings name
    the data where the generator puts them on any machine."""
    config: Any = OmegaConf.to_container(trained.cfg, resolve=True)
    for place in (config["data"], config["dataset"]["train"], config["dataset"]["val"]):
        place["root"] = f"data/{config['data']['name']}"
    write_weights(
        path,
        weights=dict(trained.weights),
        config=config | {"init": None},
        table=table,
        manifest=list(manifests),
        record=trained.record,
    )
    return path


def run_record(folder: Path, cfg: DictConfig) -> dict[str, Any]:
    """What a run was, as plain values: ``overrides`` and ``settings`` (those that differ from the default's), steps, minutes of
    training without validation, command, commit, processor, and the hashes of its data."""
    around = surroundings(folder)
    named = (
        "overrides",
        "job",
        "command",
        "git",
        "processor",
        "cores",
        "threads",
        "torch",
        "data",
        "made_by",
        "planned_steps",
    )
    record = {"run": folder.as_posix(), "seed": cfg.seed, "encoders": list(cfg.encoders)}
    record |= {name: around.get(name) for name in named} | {"settings": changed_settings(cfg)}
    last = folder / "checkpoints" / "last.ckpt"
    state = read_checkpoint(last) if last.exists() else {}
    clock = state.get("callbacks", {}).get("PlanCallback")
    return record | {"steps": state.get("global_step"), "minutes": clock and round(clock["elapsed"] / 60, 2)}


def changed_settings(cfg: DictConfig) -> dict[str, Any]:
    """The settings in which a run differs from the default of ``train.py``, by dotted name, without the seed, the place of
    its data, and what follows from other settings."""
    default = composed("train")
    written, resolved = (OmegaConf.to_container(default, resolve=resolve) for resolve in (False, True))
    changed = _changed(OmegaConf.to_container(cfg, resolve=True), resolved, written)
    return {key: value for key, value in changed.items() if key not in (*ABOUT_THE_FOLDER, "seed", "data.root")}


def _changed(own: Any, default: Any, written: Any, path: str = "") -> dict[str, Any]:
    """Leaves of ``own`` unlike ``default``, but for how they are built (``_partial_``) and for those that ``written`` (the
    default as it stands in the files) derives from others: ${...}."""
    if own == default or (isinstance(written, str) and written.startswith("${")) or path.endswith("._partial_"):
        return {}
    if not (isinstance(own, dict) and isinstance(default, dict) and isinstance(written, dict)):
        return {path[1:]: own}
    found: dict[str, Any] = {}
    is_same_kind = own.get("_target_") == default.get("_target_")  # else the default's other settings mean nothing here
    for key in dict.fromkeys([*own, *(default if is_same_kind else ())]):
        found |= _changed(own.get(key), default.get(key), written.get(key), f"{path}.{key}")
    return found
