"""Which run or file of weights a command means, found without torch: a wrong name is answered before it is imported."""

import shlex
from pathlib import Path

from omegaconf import DictConfig, OmegaConf

from fusion_net.common.cli.command_line import as_override, command_line
from fusion_net.common.cli.config_files import CONFIGS
from fusion_net.common.cli.override_values import nearest
from fusion_net.common.cli.typed import retyped
from fusion_net.runs.run_dir import MOST_NAMED, load_config, surroundings

SHIPPED = CONFIGS.parent / "checkpoints"
"""Where ``checkpoint=nano`` and ``init=nano`` find ``nano.pt``."""
EVALUATIONS = Path("runs/checkpoints")
"""Where ``eval.py checkpoint=NAME`` writes: below NAME here."""
OF_A_RUN = ("best", "last")
"""Checkpoints that every run has; another name without a run is of shipped weights."""


def source_of(cfg: DictConfig) -> Path:
    """The checkpoint of a run, or the file of shipped weights, that a command's ``run`` and ``checkpoint`` name. ValueError
    where they name neither, FileNotFoundError where it is not there."""
    if not OmegaConf.is_missing(cfg, "run"):
        return checkpoint_path(Path(cfg.run), cfg.checkpoint)
    if cfg.checkpoint not in OF_A_RUN:
        _refuse_checkpoint_of_a_run(Path(cfg.checkpoint))
        return shipped_path(cfg.checkpoint)
    found = [f"run={as_override(run.as_posix())}" for run in newest_runs()[:MOST_NAMED]]
    of_a_run = f"run={found[0].partition('=')[2]}" if found else "run=runs/NAME"
    others = f" (others, newest first: {', '.join(found[1:])})" if found[1:] else ""
    shipped = " or ".join(f"checkpoint={name}" for name in shipped_names())
    raise ValueError(f"run is needed; write {of_a_run}{others}, or take shipped weights: {shipped or 'there are none'}")


def _refuse_checkpoint_of_a_run(path: Path) -> None:
    """ValueError, with how it is written, where the path of a run's checkpoint stands for a name of shipped weights."""
    run = path.parent.parent
    if path.suffix == ".ckpt" and path.parent.name == "checkpoints" and (run / "config.yaml").exists():
        words = [f"run={as_override(run.as_posix())}", f"checkpoint={as_override(path.stem)}"]
        raise ValueError(f"checkpoint={path} is of a run; write {shlex.join(words)}")


def newest_runs(folder: Path = Path("runs")) -> list[Path]:
    """Folders of runs below a folder, the one that was begun last first."""
    configs = sorted(folder.glob("**/config.yaml"), key=lambda path: path.stat().st_mtime, reverse=True)
    return [path.parent for path in configs]


def checkpoint_path(run: Path, checkpoint: str) -> Path:
    """``RUN/checkpoints/CHECKPOINT.ckpt``. FileNotFoundError when there is no such run, or it has no such checkpoint."""
    load_config(run)  # there may be no run at all
    if not any((run / "checkpoints").glob("*.ckpt")):
        raise FileNotFoundError(
            f"no checkpoint in {run}: it has written none yet; if it was interrupted, go on with: {going_on(run)}"
        )
    return found_checkpoint(run / "checkpoints" / f"{checkpoint}.ckpt")


def going_on(run: Path) -> str:
    """The command that goes on with an interrupted run: the one that it was begun with; of a sweep, all of its jobs."""
    around = surroundings(run)
    if not around.get("command"):
        return command_line(
            "train.py", name=run.relative_to("runs") if run.is_relative_to("runs") else run.name, resume=True
        )
    flag = "resume" if around.get("job") is None else "skip_finished"
    words = [
        word for word in shlex.split(retyped(around["command"])) if not word.startswith(("overwrite=", f"{flag}="))
    ]
    return f"python {shlex.join([*words, f'{flag}=true'])}"


def found_checkpoint(path: Path) -> Path:
    """The path. FileNotFoundError, with the checkpoints beside it, when there is none."""
    if not path.exists():
        others = sorted(p.name for p in path.parent.glob("*.ckpt"))
        known = f"there are {', '.join(others)}: pass checkpoint={Path(others[0]).stem}" if others else "there are none"
        raise FileNotFoundError(f"no checkpoint {path}; {known}")
    return path


def names_weights(name: str) -> bool:
    """Whether a name is one of shipped weights or a file of weights; runs are named by their folder: runs/NAME."""
    return name.endswith((".pt", ".ckpt")) or ("/" not in name and not Path(name).is_dir())


def shipped_names() -> list[str]:
    """What ``checkpoint=`` takes without a run, ``nano`` first."""
    return sorted((path.stem for path in SHIPPED.glob("*.pt")), key=lambda name: (name != "nano", name))


def shipped_path(name: str) -> Path:
    """The file of shipped weights that a name or a path means. FileNotFoundError when there is none."""
    if not name:
        raise FileNotFoundError(
            f"give a name of shipped weights ({', '.join(shipped_names())}) or the path of a .pt file"
        )
    path = Path(name) if "/" in name or name.endswith((".pt", ".ckpt")) else SHIPPED / f"{name}.pt"
    if not path.is_file():
        for run in (Path("runs") / name, Path(name)):
            if (run / "config.yaml").exists():
                of_it = f"its weights are {run}/checkpoints/best.ckpt"
                raise FileNotFoundError(f"no shipped weights {name}; there is a run of this name: {run}; {of_it}")
        make = command_line("eval.py", run="runs/NAME", ship=f"checkpoints/{Path(name).stem}.pt")
        known = nearest(Path(name).stem, shipped_names()) if shipped_names() else "there are none"
        raise FileNotFoundError(
            f"no shipped weights {name}; {f'{known} Files' if known.endswith('?') else f'{known}; files'} are named by their"
            f" path (.pt); of a run: {make}"
        )
    return path
