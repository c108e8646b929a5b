"""How a generated tree was made, as its manifest says."""

import re
import shlex
from pathlib import Path
from typing import Any


def generating_command(root: Path, manifest: dict[str, Any]) -> str:
    """What to type to make the tree in ``root``, or to go on with it; "" where the manifest does not say.

    The manifest keeps the command without its folder, so that a copy or a moved tree tells its own. A shard lies in the
    folder that the command names.
    """
    command = manifest.get("command", "")
    folder = str(root.parent if manifest.get("shard") else root)
    quoted = folder if re.fullmatch(r"[\w./-]+", folder) else f"'{folder}'"  # as Hydra reads it
    return f"{command} {shlex.quote(f'data.root={quoted}')}" if command else ""
