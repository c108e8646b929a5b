"""What to answer where there is no data: the data that is there, and the command that makes what is missing."""

import difflib
from collections.abc import Sequence
from pathlib import Path

from fusion_net.common.cli.command_line import as_override, command_line
from fusion_net.common.cli.config_files import CONFIGS
from fusion_net.nuscenes.tables import manifest, versions

PLACE = Path("data")
"""Where the generator puts data sets unless it is told otherwise."""
MOST_NAMED = 3
"""Data sets that a message names."""


def refuse_no_data(root: Path) -> None:
    """ValueError where a folder of data is not there, or is empty."""
    if root.is_dir() and any(root.iterdir()):
        return
    own = [f"data.root={as_override(folder)}" for folder in data_sets_near(root)[:MOST_NAMED]]
    others = f" (others: {', '.join(own[1:])})" if own[1:] else ""
    use = f"write {own[0]}{others}, or make some" if own else "make some"
    if root.exists() and not root.is_dir():
        raise ValueError(f"no data in {root}, which is a file; {use}: {making(root.with_suffix(''))}")
    raise ValueError(f"no data in {root}; {use}: {making(root)}")


def check_data(root: str | Sequence[str] | None) -> None:
    """The same for ``data.root``, a folder or a list of them; ValueError where it names none."""
    if not root:
        raise ValueError(f"data.root={as_override(root)} names no folder of data; write data.root=DIR")
    for folder in [root] if isinstance(root, str) else root:
        refuse_no_data(Path(folder))


def making(root: Path) -> str:
    """The command that generates a data set into a folder; what kind its name says: ``data/sequence``, ``data/surround``."""
    is_kind = (CONFIGS / "data" / f"{root.name}.yaml").exists()
    return command_line("-m data_gen", data=root.name if is_kind else "nano", data__root=root)


def data_sets_near(root: Path) -> list[Path]:
    """Data sets beside a folder that has none, and where the generator puts them, those of a similar name first."""
    folders = {path for place in (root.parent, PLACE) for path in place.glob("*") if path != root}
    alike = {path: difflib.SequenceMatcher(None, path.name, root.name).ratio() for path in folders}
    return sorted(filter(_is_data, folders), key=lambda path: (-alike[path], path))


def _is_data(folder: Path) -> bool:
    """Whether a folder holds a data set that is whole, or shards of one."""
    try:
        about = manifest(folder)
        return bool(about.get("complete", True) and (versions(folder) or any(folder.glob("shard-*-of-*/v1.0-*"))))
    except (ValueError, OSError):  # damaged, or not for us to read
        return False
