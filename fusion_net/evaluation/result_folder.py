"""Where an evaluation's results go: RUN/eval for what the run validated on, a folder inside it for anything else."""

import hashlib
import re
from collections.abc import Sequence
from pathlib import Path

from fusion_net.nuscenes.nuscenes import NuScenes

Roots = str | Sequence[str]
LONGEST = 60
"""Characters of a split's or a data root's part of a folder's name, before its hash."""


def result_folder(
    run: Path,
    datasets: Sequence[NuScenes],
    *,
    split: str,
    own_split: str,
    root: Roots,
    own_root: Roots,
    version: str | None = None,
    own_version: str | None = None,
    checkpoint: str = "best",
    fault: str = "",
    variant: str = "",
) -> Path:
    """RUN/eval[/SPLIT[@ROOT[/VERSION]]][/CHECKPOINT][/FAULT][/VARIANT]: parts only for what differs from the split (of
    ``datasets``), the data, the best checkpoint, the sound sensors and the model of the run's own validation, so that no
    evaluation overwrites another."""
    samples = ""
    if not is_same_data(root, own_root) or version not in (None, own_version):
        samples = f"{_name(split)}@{'+'.join(_name(_shown(path)) for path in _folders(root))}/{version or ''}"
    elif any(nusc.split_name(split) != nusc.split_name(own_split) for nusc in datasets):
        samples = _name(split)
    return run / "eval" / samples / ("" if checkpoint == "best" else checkpoint) / fault / variant


def is_same_data(root: Roots, other: Roots) -> bool:
    """Whether two values of ``data.root`` name the same folders."""
    return sorted(_folders(root)) == sorted(_folders(other))


def _folders(root: Roots) -> list[Path]:
    return [Path(path).resolve() for path in ([root] if isinstance(root, str) else root)]


def _shown(path: Path) -> str:
    """A folder as one would type it here."""
    return str(path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path)


def _name(text: str) -> str:
    """A part of a folder's name: letters, digits, dots, underscores, and dashes for the slashes; with a hash where that
    alone could be the name of another text."""
    plain = re.sub(r"[^\w.]+", "-", text, flags=re.ASCII).strip("-")
    if len(plain) <= LONGEST and plain.replace("-", "/") == text:
        return plain
    return f"{plain[-LONGEST:].strip('-')}-{hashlib.sha256(text.encode()).hexdigest()[:6]}"
